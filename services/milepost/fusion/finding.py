"""What one scalar observation of a unit tells against each hypothesis."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from milepost.estimation.layout import Array

from .bank_state import Channel
from .evidence import OUT_OF_RANGE, STUCK, Bounds, Flags, statistics


class Finding(NamedTuple):
    """What one scalar observation of a unit says.

    `uses` (H): which rows use it; `channel` after it; `stuck`: the unit said the same too often; `far` (H): what was learned
    of the unit is out of range, None: nowhere; `struck` (H): two readings in a row were refused by themselves, None: nowhere.
    """

    unit: str
    at_ns: int
    uses: Flags
    channel: Channel
    struck: Flags | None
    stuck: bool = False
    far: Flags | None = None

    def beyond(self, bounds: Bounds) -> Flags | None:
        """Which rows (H) anything tells against; None where nothing does, which is nearly always."""
        exceeded = bounds.exceeded(self.channel.sums, self.channel.readings)
        if self.stuck:
            return np.ones_like(self.uses)
        if not np.count_nonzero(exceeded) and self.far is None and self.struck is None:
            return None
        out = exceeded.any(axis=0)
        for more in (self.far, self.struck):
            out = out if more is None else out | more
        return np.asarray(out)

    def worst(self) -> Array:
        """The worst test of each row (H)."""
        if self.stuck:
            return np.full(len(self.uses), np.inf)
        worst: Array = statistics(self.channel.sums, self.channel.readings).max(axis=0)
        return worst if self.struck is None else np.where(self.struck, np.inf, worst)

    def test(self, row: int) -> int:
        """What tells most against a row."""
        if self.stuck:
            return STUCK
        if self.far is not None and self.far[row]:
            return OUT_OF_RANGE
        return int(np.argmax(statistics(self.channel.sums, self.channel.readings)[:, row]))
