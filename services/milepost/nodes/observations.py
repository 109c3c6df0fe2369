"""Messages as observations, with the same identity and place in every timeline."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from milepost.estimation.observation import UNTIMELY, Observation
from milepost.sensors.observed import Observed
from milepost_schemas import AbsoluteFix, Estimate, Message, from_fields

POSITION = (1.0, 0.0, 0.0)


# the component of a restored calibration, which is sent with a reading but is none of its rows
RESTORED_COMPONENT = 100
HEAD = frozenset(Message.model_fields)


def of_reading(reading: Message, order: int, observed: Iterable[Observed], first_component: int = 0) -> list[Observation]:
    """A reading's observations; `order` is its unit's row in the train file."""
    head = (reading.measured_at_ns, order, reading.sequence, reading.instance)
    return [Observation(*head, i, reading.unit, *seen) for i, seen in enumerate(observed, start=first_component)]


def of_estimate(estimate: Estimate, order: int) -> list[Observation]:
    """An estimate's rows as observations; `order` is its unit's row in the train file."""
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


def whole_readings(estimate: Estimate, order: int, message: type[Message], rows: list[Observation]) -> list[Observation]:
    """An estimate's whole readings, which the fuser judges, and those of its `rows` that belong to none of them.

    Raises Refused for fields that are not in the schema `message`.
    """
    out = []
    for r in estimate.readings:
        if r.why in UNTIMELY:
            continue  # it only tells that the unit is heard
        head = {"train": estimate.train, "unit": estimate.unit, "instance": r.sensor_instance, "sequence": r.reading_sequence}
        times = {"measured_at_ns": r.measured_at_ns, "published_at_ns": estimate.published_at_ns}
        reading = from_fields({**r.fields, **head, **times}, message)
        out.append(
            Observation(r.measured_at_ns, order, r.reading_sequence, r.sensor_instance, 0, estimate.unit, (), reading=reading)
        )
    stated = {(o.instance, o.sequence) for o in out}
    return out + [o for o in rows if o.component >= RESTORED_COMPONENT or (o.instance, o.sequence) not in stated]


def as_judged(reading: Message, counts: bool, why: str | None, gating: bool = False) -> dict[str, Any]:
    """A reading and its filter's judgement as the fields of a JudgedReading."""
    return {
        "sensor_instance": reading.instance,
        "reading_sequence": reading.sequence,
        "measured_at_ns": reading.measured_at_ns,
        "fields": {name: value for name, value in reading.__dict__.items() if name not in HEAD and value is not None},
        "counts": counts,
        "why": why,
        "gating": gating,
    }


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
