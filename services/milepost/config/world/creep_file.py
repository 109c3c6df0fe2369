"""The creep of a world's wheels in a train file."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated

from pydantic import AfterValidator, BaseModel, Field, model_validator

from milepost.recordings.options import STRICT
from milepost.simulation.creep import Adhesion, Creep, CreepEvent
from milepost.simulation.motion import Motion
from milepost.track.line import Line
from milepost_schemas.message import Name

Seconds = Annotated[float, Field(ge=0.0, le=1e7)]
Friction = Annotated[float, Field(gt=0.0, le=1.0)]


def _rising(span: list[float]) -> list[float]:
    if span[0] > span[1]:
        raise ValueError("the lower friction must come first")
    return span


Frictions = Annotated[list[Friction], Field(min_length=2, max_length=2), AfterValidator(_rising)]


class CreepEventFile(BaseModel):
    """A spin (`ratio` above 0) or slide (below 0; -1 is a locked wheel); without `units`, of all wheels."""

    model_config = STRICT
    from_s: Seconds
    to_s: Seconds
    ratio: Annotated[float, Field(ge=-1.0, le=10.0)]
    ramp_s: Seconds = 0.5
    units: list[Name] | None = None

    @model_validator(mode="after")
    def _ends(self) -> CreepEventFile:
        if self.to_s <= self.from_s:
            raise ValueError("to_s: must come after from_s")
        return self


class AdhesionFile(BaseModel):
    """Friction in patches along the line, and how far a wheel creeps beyond it; see `simulation.creep.Adhesion`."""

    model_config = STRICT
    dry: Frictions = [0.15, 0.30]
    poor: Frictions = [0.03, 0.08]
    poor_part: Annotated[float, Field(ge=0.0, le=1.0)] = 0.1
    patch_m: Annotated[float, Field(ge=1.0, le=1e4)] = 40.0
    driven_part: Annotated[float, Field(gt=0.0, le=1.0)] = 0.67
    creep_per_excess: Annotated[float, Field(ge=0.0, le=10.0)] = 0.3
    largest_creep: Annotated[float, Field(ge=0.0, le=10.0)] = 0.5
    units: list[Name] | None = None

    def build(self) -> Adhesion:
        """The adhesion model of the simulation."""
        return Adhesion(
            (self.dry[0], self.dry[1]),
            (self.poor[0], self.poor[1]),
            self.poor_part,
            self.patch_m,
            self.driven_part,
            self.creep_per_excess,
            self.largest_creep,
            _tuple(self.units),
        )


class CreepFile(BaseModel):
    """Scheduled events and, where `adhesion` stands, spontaneous spin and slide."""

    model_config = STRICT
    events: list[CreepEventFile] = Field(default_factory=list)
    adhesion: AdhesionFile | None = None

    def units_named(self) -> Iterator[tuple[str, str]]:
        """Each (field, unit) where a unit is named."""
        for number, event in enumerate(self.events):
            yield from ((f"events.{number}.units", unit) for unit in event.units or ())
        if self.adhesion is not None:
            yield from (("adhesion.units", unit) for unit in self.adhesion.units or ())

    def build(self, motion: Motion, line: Line, seed: int) -> Creep:
        """The creep of a world."""
        events = [CreepEvent(e.from_s, e.to_s, e.ratio, e.ramp_s, _tuple(e.units)) for e in self.events]
        return Creep(motion, line, seed, events, self.adhesion.build() if self.adhesion else None)


def _tuple(units: list[str] | None) -> tuple[str, ...] | None:
    return None if units is None else tuple(units)
