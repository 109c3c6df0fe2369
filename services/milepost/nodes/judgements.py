"""What the filters judged of their readings, noted with the fuser's units."""

from __future__ import annotations

from milepost.estimation.observation import Observation
from milepost_schemas import Estimate

from .roster import Roster


def note_judgements(roster: Roster, estimate: Estimate, rows: list[Observation], taken: set[int]) -> None:
    """Note the filter's judgements: shares use them, and so does the presence of units that the fuser does not judge."""
    unit, judged = estimate.unit, {r.measured_at_ns for r in estimate.readings}
    for reading in estimate.readings:
        if reading.measured_at_ns in taken and reading.counts:
            roster.counted(unit, reading.measured_at_ns)
        elif reading.measured_at_ns in taken and reading.why is not None:
            roster.refused(unit, reading.measured_at_ns, reading.why, reading.gating)
    for row in rows:
        roster.informed(unit, row)
        if row.measured_at_ns not in judged:
            roster.counted(unit, row.measured_at_ns)
