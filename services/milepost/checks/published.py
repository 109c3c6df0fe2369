"""What the checks look at: the epochs of one estimator that publishes intervals."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


class Published(Protocol):
    """K epochs of published states and of the truth; None where the estimator has no such thing.

    `states` and `truth` (K, 3) of [s m, v m/s, a m/s²]. `bounds` (K, 4): the position interval, m, and the speed interval, m/s.
    `accuracy` (K, 2): the errors of position, m, and speed, m/s, that 95 % stay within, without faults. `since_balise_m` (K):
    the distance since the last balise, NaN where none was passed yet; `location_accuracy_m` (K): how well its place is known.
    `steps_m` (K, 2): what `steps_beyond_travelled_m` computes. `lost` (K): the status was `lost`. `stamps_s`: what times the
    states were about, in the order in which they were published.
    """

    @property
    def states(self) -> Array: ...
    @property
    def truth(self) -> Array | None: ...
    @property
    def bounds(self) -> Array | None: ...
    @property
    def accuracy(self) -> Array | None: ...
    @property
    def since_balise_m(self) -> Array | None: ...
    @property
    def location_accuracy_m(self) -> Array | None: ...
    @property
    def steps_m(self) -> Array | None: ...
    @property
    def lost(self) -> Flags | None: ...
    @property
    def stamps_s(self) -> Array | None: ...
