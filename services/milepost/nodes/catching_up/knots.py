"""Observations as what msgpack can hold: so many that they are packed with as little work as can be."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from milepost.estimation.observation import Observation
from milepost.nodes.fuser_settings import FuserSettings
from milepost_schemas import Message, Refused, from_fields

from .codec import Misfit, of

# all fields of an observation but the reading, which comes last
HEAD = len(Observation._fields) - 1
COLUMNS = [of(hint) for hint in (int, int, int, str, int, str, tuple[float, ...], float, float)]


class Knots:
    """The observations of one train, each a list of its fields; of a whole reading the message's fields."""

    def __init__(self, settings: FuserSettings) -> None:
        self._orders = {row.unit: row.order for row in settings.units}
        self._schemas: dict[str, type[Message]] = {unit: judge.message for unit, judge in settings.judges.items()}
        self._dimension = settings.layout.dimension

    def pack(self, knots: Sequence[Observation]) -> list[Any]:
        """The fields of each. Raises Misfit for a reading that is no message of its unit."""
        out: list[Any] = []
        for knot in knots:
            reading = knot.reading
            if reading is not None and type(reading) is not self._schemas.get(knot.unit):
                raise Misfit(f"{knot.unit}: a reading of another kind")
            out.append([*knot[:HEAD], None if reading is None else reading.__dict__])
        return out

    def unpack(self, value: Any) -> list[Observation]:
        """The observations. Raises Misfit for one that no unit of this train can have made."""
        if type(value) is not list:
            raise Misfit("a list expected")
        return [self._one(each) for each in value]

    def _one(self, value: Any) -> Observation:
        if type(value) is not list or len(value) != HEAD + 1:
            raise Misfit("an observation expected")
        head = [coder.unpack(each) for coder, each in zip(COLUMNS, value[:HEAD], strict=True)]
        knot = Observation(*head)
        if self._orders.get(knot.unit) != knot.order:
            raise Misfit(f"{knot.unit} is another unit of this train, or none")
        if value[HEAD] is not None:
            return knot._replace(reading=self._reading(knot, value[HEAD]))
        if len(knot.row) != self._dimension or not all(map(math.isfinite, (*knot.row, knot.value, knot.variance))):
            raise Misfit(f"{knot.unit}: a row expected")
        if knot.variance <= 0.0:
            raise Misfit(f"{knot.unit}: no variance")
        return knot

    def _reading(self, knot: Observation, fields: Any) -> Message:
        schema = self._schemas.get(knot.unit)
        if schema is None:
            raise Misfit(f"{knot.unit}: its readings are not judged here")
        try:
            reading = from_fields(fields, schema)
        except Refused as refused:
            raise Misfit(f"{knot.unit}: {refused.detail}") from None
        if knot[:HEAD] != (
            reading.measured_at_ns,
            knot.order,
            reading.sequence,
            reading.instance,
            0,
            reading.unit,
            (),
            0.0,
            0.0,
        ):
            raise Misfit(f"{knot.unit}: a reading of another time")
        return reading
