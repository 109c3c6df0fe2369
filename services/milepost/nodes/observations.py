"""Messages as observations, with the identity and the place that every timeline agrees on."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from milepost.estimation.timeline import Observation
from milepost.sensors.base import Observed
from milepost_schemas import AbsoluteFix, Estimate, Message

POSITION = (1.0, 0.0, 0.0)


def of_reading(reading: Message, order: int, observed: Iterable[Observed]) -> list[Observation]:
    """A reading's observations; `order` is its unit's row in the train file."""
    head = (reading.measured_at_ns, order, reading.sequence, reading.instance)
    return [Observation(*head, i, reading.unit, *seen) for i, seen in enumerate(observed)]


def of_estimate(estimate: Estimate, order: int) -> list[Observation]:
    """The observations that a filter passes on: the same ones, whoever repeats them."""
    return [
        Observation(
            o.measured_at_ns,
            order,
            o.reading_sequence,
            o.sensor_instance,
            o.component,
            estimate.unit,
            tuple(o.row),
            o.value,
            o.variance,
        )
        for o in estimate.observations
    ]


def as_fields(o: Observation) -> dict[str, Any]:
    """An observation as the fields of a LinearObservation; its row must be over its own unit's states."""
    return {
        "sensor_instance": o.instance,
        "reading_sequence": o.sequence,
        "component": o.component,
        "measured_at_ns": o.measured_at_ns,
        "row": list(o.row),
        "value": o.value,
        "variance": o.variance,
    }


def of_fix(fix: AbsoluteFix, order: int) -> Observation:
    """A fix as one observation of position; `order` is its reader's row."""
    head = (fix.measured_at_ns, order, fix.reading_sequence, fix.reader_instance, 0, fix.reader)
    return Observation(*head, POSITION, fix.position_m, fix.position_variance_m2)
