"""What one scalar observation of a unit tells against each hypothesis."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from milepost.estimation.layout import Array

from .bank_state import Channel
from .evidence import OUT_OF_RANGE, STUCK, Bounds, Flags, statistics, unheard


class Finding(NamedTuple):
    """What one scalar observation of a unit says.

    `uses` (H): which rows use it; `channel` after it; `stuck`: the unit said the same too often; `far` (H): what was learned
    of the unit is out of range, None: nowhere; `struck` (H): two readings in a row were refused by themselves, None: nowhere.
    `common`: of a unit that is excluded, the part of its innovations' variance in the leading row that is the row's own. The
    row does not hear the unit, so that the same error is in many of them.
    """

    unit: str
    at_ns: int
    uses: Flags
    channel: Channel
    struck: Flags | None
    stuck: bool = False
    far: Flags | None = None
    common: float = 0.0

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

    def worst(self, common: float = 0.0) -> Array:
        """The worst test of each row (H); `common`: for a row that does not hear the unit."""
        if self.stuck:
            return np.full(len(self.uses), np.inf)
        worst: Array = self._tests(common).max(axis=0)
        return worst if self.struck is None else np.where(self.struck, np.inf, worst)

    def test(self, row: int, common: float = 0.0) -> int:
        """What tells most against a row; `common`: for one that does not hear the unit."""
        if self.stuck:
            return STUCK
        if self.far is not None and self.far[row]:
            return OUT_OF_RANGE
        return int(np.argmax(self._tests(common)[:, row]))

    def _tests(self, common: float) -> Array:
        sums, count = self.channel.sums, self.channel.readings
        return unheard(sums, count, common) if common > 0.0 else statistics(sums, count)
