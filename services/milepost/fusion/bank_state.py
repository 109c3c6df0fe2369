"""The state of the bank of hypotheses, and how its rows are taken over."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from milepost.estimation.layout import Array

from .hypotheses import Flags, Rows
from .verdicts import Reset, Verdict

# a reading may have two rows: the tests of each are apart
CHANNELS = 2


class Bank(NamedTuple):
    """The kernel's state: H hypotheses over n states, and what was heard of each unit.

    `x` (H, n), `P` (H, n, n); `alive` (H): not refuted; `dead_ns` (H): when refuted, 0 for those alive. For the tests:
    `sums` (H, channels, 6), `counts` (channels), `strikes` (H, channels) of readings in a row that were refused by themselves,
    `nu` (H, channels) the last innovations. `leader`: the row that is published. `since_ns`: the time of the first observation
    that counted.
    """

    rows: Rows
    x: Array
    P: Array
    alive: Flags
    dead_ns: tuple[int, ...]
    sums: Array
    counts: tuple[int, ...]
    strikes: NDArray[np.int_]
    nu: Array
    verdicts: Mapping[str, Verdict]
    leader: int = 0
    since_ns: int | None = None
    reset: Reset | None = None

    @property
    def doubted(self) -> tuple[str, ...]:
        """The units of which one lies, while nothing tells which."""
        if self.alive[0]:
            return ()
        plausible = self.rows.plausible(self.alive)
        sets = [units - self.rows.excluded for units, held in zip(self.rows.sets, plausible, strict=True) if held]
        return tuple(sorted(frozenset().union(*sets)))


def recomposed(state: Bank, rows: Rows, index: list[int]) -> Bank:
    """The bank with other rows, each the continuation of the old row `index`."""
    H = len(rows.sets)
    return state._replace(
        rows=rows,
        x=state.x[index],
        P=state.P[index],
        sums=state.sums[index],
        nu=state.nu[index],
        strikes=np.zeros_like(state.strikes[index]),
        alive=np.ones(H, dtype=bool),
        dead_ns=(0,) * H,
        leader=0,
    )


def led(state: Bank, row: int, at_ns: int, reason: str) -> Bank:
    """Another row leads; a step that is larger than the new row's own uncertainty is noted."""
    old, new = state.x[state.leader], state.x[row]
    step_m, step_mps = float(new[0] - old[0]), float(new[1] - old[1])
    variances = np.diagonal(state.P[row])
    far = abs(step_m) > 2.0 * math.sqrt(variances[0]) or abs(step_mps) > 2.0 * math.sqrt(variances[1])
    return state._replace(leader=row, reset=Reset(at_ns, step_m, step_mps, reason) if far else state.reset)


def protected(state: Bank, place: int) -> tuple[float, float]:
    """[min, max] of the state at `place` over the hypotheses that are not refuted: the union of x_h ± K_h σ_h."""
    held = state.rows.published(state.alive)
    reach = state.rows.reach(state.alive)[held] * np.sqrt(state.P[held, place, place])
    centre = state.x[held, place]
    return float((centre - reach).min()), float((centre + reach).max())
