"""What the fuser decided of its units, as events: once when it changes."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import NamedTuple

from milepost.estimation.time_units import S_PER_NS
from milepost.fusion.hypotheses import MOTION_MODEL
from milepost.fusion.rule import Fused
from milepost.fusion.verdicts import Reset, Verdict
from milepost.nodes.base import Severity
from milepost.nodes.roster import Presence
from milepost.nodes.working_states import GONE, LATE, NEVER_HEARD, SILENT, kind_of
from milepost_schemas.state import SAYS_NOTHING

# so long nothing may be heard of a unit at first
PATIENCE_NS = 1_000_000_000
MISSING = {GONE: "its process is gone", NEVER_HEARD: "nothing was heard of it", SILENT: "nothing is heard of it any more"}


class Reported(NamedTuple):
    """What was reported: exclusions, doubts, the last refused fix of each unit, the last reset, units that say nothing.

    `first_ns`: the first epoch.
    """

    excluded: dict[str, Verdict]
    doubted: tuple[str, ...]
    refused: dict[str, int]
    reset: Reset | None
    missing: dict[str, str]
    first_ns: int | None


class Decisions:
    """The decisions that were reported so far."""

    def __init__(self) -> None:
        self._excluded: dict[str, Verdict] = {}
        self._doubted: tuple[str, ...] = ()
        self._refused: dict[str, int] = {}
        self._reset: Reset | None = None
        self._missing: dict[str, str] = {}
        self._first_ns: int | None = None

    @property
    def memory(self) -> Reported:
        """What was reported, so that another fuser does not report it again."""
        # what a unit's judge remembers is the bank's
        excluded = {unit: v._replace(memory=None, said=None, noise=()) for unit, v in self._excluded.items()}
        return Reported(excluded, self._doubted, dict(self._refused), self._reset, dict(self._missing), self._first_ns)

    @memory.setter
    def memory(self, other: Reported) -> None:
        self._excluded, self._doubted, self._refused, self._reset, self._missing, self._first_ns = other

    def news(self, fused: Fused, presence: Presence, epoch_ns: int) -> Iterator[tuple[Severity, str, str]]:
        """(severity, code, text) of what changed with the state at an epoch."""
        self._first_ns = epoch_ns if self._first_ns is None else self._first_ns
        if epoch_ns - self._first_ns >= PATIENCE_NS:
            yield from self._of_presence(presence)
        for unit, verdict in fused.verdicts.items():
            yield from self._of_unit(unit, verdict)
        if fused.doubted != self._doubted:
            if fused.doubted:
                yield "warning", "units_doubted", f"one of {', '.join(fused.doubted)} is wrong, and nothing tells which"
            elif self._doubted:
                yield "info", "doubt_settled", f"of {', '.join(self._doubted)}"
            self._doubted = fused.doubted
        reset = fused.reset
        if reset is not None and (self._reset is None or reset.at_ns > self._reset.at_ns):
            text = f"the state stepped by {reset.size_m:+.2f} m, {reset.size_mps:+.3f} m/s: {reset.reason}"
            yield "warning", "state_reset", text
            self._reset = reset

    def _of_presence(self, presence: Presence) -> Iterator[tuple[Severity, str, str]]:
        """Of units that say nothing in time."""
        now = {unit: reason for unit, reason in presence.excluded.items() if kind_of(reason) in SAYS_NOTHING}
        for unit, reason in now.items():
            if self._missing.get(unit) != reason:
                late = f"its readings come {presence.behind_s[unit]:.2f} s late" if reason == LATE else ""
                yield "warning", f"unit_{kind_of(reason)}", f"{unit} is {kind_of(reason)}: {late or MISSING[reason]}"
        for unit in self._missing.keys() - now.keys():
            yield "info", "unit_heard", f"{unit} is heard in time again"
        self._missing = now

    def _of_unit(self, unit: str, verdict: Verdict) -> Iterator[tuple[Severity, str, str]]:
        if unit == MOTION_MODEL:
            yield from self._of_motion(verdict)
            return
        now, before = verdict.kind, self._excluded.get(unit)
        if now is not None and (before is None or before.kind != now):
            yield "warning", "unit_excluded", f"{unit} is {now}: {verdict.evidence}"
        if now is not None:
            self._excluded[unit] = verdict
        elif before is not None and before.excluded is not None:
            del self._excluded[unit]
            heard_ns = verdict.heard_ns or before.excluded.at_ns
            after_s = (heard_ns - before.excluded.at_ns) * S_PER_NS
            yield "info", "unit_readmitted", f"{unit} agrees with the others again, {after_s:.1f} s after it was excluded"
        odd_ns = verdict.odd_ns[-1] if verdict.odd_ns else 0
        if odd_ns > self._refused.get(unit, 0):
            self._refused[unit] = odd_ns
            yield "warning", "fix_refused", f"{unit}: a fix is too far from where the train is: it does not count"

    def _of_motion(self, verdict: Verdict) -> Iterator[tuple[Severity, str, str]]:
        known = MOTION_MODEL in self._excluded
        if verdict.excluded is not None and not known:
            self._excluded[MOTION_MODEL] = verdict
            text = f"the train moves harder than its motion model says: {verdict.evidence}"
            yield "warning", "motion_model_exceeded", text
        elif verdict.excluded is None and known:
            del self._excluded[MOTION_MODEL]
            yield "info", "motion_model_used_again", "the motion model is used again"


def only_decided(verdicts: Mapping[str, Verdict], filtered: set[str]) -> dict[str, Verdict]:
    """The fuser's own verdicts; of the units that their filters judge, only that they are excluded."""
    return {unit: v for unit, v in verdicts.items() if v.excluded is not None or unit not in filtered}
