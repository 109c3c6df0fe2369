"""What is measured of a stretch of states: gaps, errors, violated intervals, epochs missing."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from milepost.checks.stalls import Stall, stalled_ns
from milepost_schemas import FusedState, Truth

Received = tuple[int, FusedState]


@dataclass
class Figures:
    """The figures of a stretch; `stall_s`: the part of the longest gap in which a processor of the machine stood still.

    `repeated`: states of epochs that were there before, `contradicted`: those of them that place the train outside the
    other's interval, though neither awaited anything. `refused`: messages that the train's processes refused meanwhile.
    """

    states: int = 0
    gap_s: float = 0.0
    stall_s: float = 0.0
    error_m: float = 0.0
    compared: int = 0
    violations: int = 0
    missing: int = 0
    repeated: int = 0
    contradicted: int = 0
    refused: int = 0
    recovery_s: float | None = None

    @property
    def own_gap_s(self) -> float:
        """The longest gap without the machine's own stall in it."""
        return max(0.0, self.gap_s - self.stall_s)


def measure(received: Sequence[Received], truths: Mapping[int, Truth], stalls: Sequence[Stall], until_ns: int) -> Figures:
    """The figures of states as received; a gap lasts from a state to the next one of a later epoch, the last to `until_ns`."""
    out = Figures(states=len(received))
    newest: Received | None = None
    said: dict[int, FusedState] = {}
    for at_ns, state in received:
        out.contradicted += _contradicts(said.setdefault(state.epoch, state), state)
        if newest is not None and state.epoch <= newest[1].epoch:
            out.repeated += 1
            continue
        if newest is not None:
            _gap(out, newest[0], at_ns, stalls)
        newest = at_ns, state
    if newest is not None:
        _gap(out, newest[0], until_ns, stalls)
    epochs = {state.epoch for _, state in received}
    out.missing = max(epochs) - min(epochs) + 1 - len(epochs) if epochs else 0
    for _, state in received:
        if (truth := truths.get(state.measured_at_ns)) is not None:
            _compare(out, state, truth)
    return out


def _contradicts(first: FusedState, again: FusedState) -> bool:
    """Whether of two states of an epoch one places the train where the other says that it is not; neither awaited anything."""
    if first.awaiting or again.awaiting:
        return False
    pairs = (first, again), (again, first)
    return not all(bounds.position_min_m <= place.position_m <= bounds.position_max_m for bounds, place in pairs)


def _gap(out: Figures, before_ns: int, after_ns: int, stalls: Sequence[Stall]) -> None:
    gap_s = (after_ns - before_ns) * 1e-9
    stall_s = stalled_ns(stalls, before_ns, after_ns) * 1e-9
    # two gaps are compared by what is the train's own
    if gap_s - stall_s > out.gap_s - out.stall_s:
        out.gap_s, out.stall_s = gap_s, stall_s


def _compare(out: Figures, state: FusedState, truth: Truth) -> None:
    out.compared += 1
    out.error_m = max(out.error_m, abs(state.position_m - truth.position_m))
    inside = state.position_min_m <= truth.position_m <= state.position_max_m
    inside_speed = state.speed_min_mps <= truth.speed_mps <= state.speed_max_mps
    out.violations += not (inside and inside_speed)
