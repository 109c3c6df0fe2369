"""What the filters judged of their readings, noted with the fuser's units."""

from __future__ import annotations

from milepost.estimation.observation import UNTIMELY, Observation
from milepost_schemas import Estimate

from .roster import Roster


def note_judgements(
    roster: Roster, estimate: Estimate, rows: list[Observation], accepted: set[int], judged_here: bool, now_ns: int
) -> None:
    """Note the filter's judgements: shares use them, and so does the presence of units that the fuser does not judge.

    `rows` of the estimate; `accepted`: the times whose observations the fuser took; `judged_here`: it judges the readings too.
    """
    unit, judged, taken = estimate.unit, {r.measured_at_ns for r in estimate.readings}, set(accepted)
    if not judged_here:
        taken |= {reading.measured_at_ns for reading in estimate.readings if not reading.counts}
    for reading in estimate.readings:
        if reading.why in UNTIMELY:
            roster.arrived(unit, reading.measured_at_ns, now_ns, untimely=True)
        elif reading.measured_at_ns in taken and reading.counts:
            roster.counted(unit, reading.measured_at_ns)
        elif reading.measured_at_ns in taken and reading.why is not None:
            roster.refused(unit, reading.measured_at_ns, reading.why, reading.gating)
    for row in rows:
        if row.measured_at_ns not in taken:
            continue
        roster.informed(unit, row)
        if row.measured_at_ns not in judged:
            roster.counted(unit, row.measured_at_ns)
