"""THE TABLE OF WORKING STATES: the words for why a unit is not in use, and the kind that machines read."""

from __future__ import annotations

from collections.abc import Mapping

from milepost.fusion.verdicts import Verdict
from milepost_schemas.state import WorkingState

GONE, NEVER_HEARD, SILENT, LATE, AHEAD, NO_USE = (
    "process gone",
    "never heard",
    "silent",
    "late",
    "stamped ahead of time",
    "no usable reading",
)
# of the motion model, which is no unit
EXCEEDED = "exceeded"
# of a unit that is refused for another reason, its own filter or judge lets nothing count
KINDS: Mapping[str, WorkingState] = {
    GONE: "absent",
    NEVER_HEARD: "absent",
    SILENT: "silent",
    LATE: "late",
    "jumping": "jumping",
    "biased": "biased",
    "noisy": "noisy",
    "stuck": "stuck",
    "out of range": "out_of_range",
    "drifting": "drifting",
    "intermittent": "intermittent",
    "spinning": "slipping",
    "sliding": "slipping",
    EXCEEDED: "exceeded",
}


def kind_of(reason: str) -> WorkingState:
    """The kind of a reason for which a unit is not in use."""
    return KINDS.get(reason, "refused")


def reason_not_in_use(verdict: Verdict, epoch_ns: int, stale_ns: int) -> str | None:
    """The reason for which a unit is not in use at an epoch; None where it is."""
    if verdict.heard_ns is None:
        return NEVER_HEARD
    if epoch_ns - verdict.heard_ns > stale_ns:
        return SILENT
    if verdict.excluded is not None:
        return verdict.kind
    if verdict.gating is not None:
        return verdict.gating
    if verdict.counted_ns is None or epoch_ns - verdict.counted_ns > stale_ns:
        return verdict.refused or NO_USE
    return None
