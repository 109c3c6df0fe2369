"""Faults that change what a reading says: its value, its position, its age."""

from __future__ import annotations

import math
from typing import Annotated, Any

from pydantic import BaseModel, Field

from milepost.recordings.options import STRICT
from milepost.track.earth import moved
from milepost.track.track import Track
from milepost_schemas import InertialReading, PositionReading, SpeedReading

from ..noise import standard_normal
from .effect import Moment, Sent, with_content_of

CREEP_RAMP_S = 0.5
LEAST_BOUND_MPS = 1e-3
LONGEST_AGE_S = 60.0
Positive = Annotated[float, Field(gt=0.0)]


class Options(BaseModel):
    """The options of a kind of fault."""

    model_config = STRICT


class Size(Options):
    """Of bias and jump."""

    size: float = Field(description="in the unit's measure: m/s of a speed, m along the track, m/s² of forward force")


class Rate(Options):
    """Of ramp."""

    rate: float = Field(description="the unit's measure (m/s, m along the track, m/s²) per second")


class Factor(Options):
    """Of scale."""

    factor: float = Field(description="the speed, or the forward force, is multiplied by it")


class Noise(Options):
    """Of noise."""

    factor: Positive = Field(description="noise of so many standard deviations is added")
    std: Positive | None = Field(None, description="the standard deviation; default: the reading's, or the unit's, own")


class Intermittent(Options):
    """Of intermittent."""

    size: float = Field(description="as of bias")
    period_s: Positive = Field(2.0, description="s from one onset to the next")
    duty: Annotated[float, Field(gt=0.0, lt=1.0)] = Field(0.5, description="the part of the period for which it is on")


class Spin(Options):
    """Of spin."""

    ratio: Positive = Field(description="the wheel turns at (1 + ratio) times the train's speed")


class Slide(Options):
    """Of slide."""

    ratio: Annotated[float, Field(ge=-1.0, lt=0.0)] = Field(
        description="the wheel turns at (1 + ratio) times the train's speed"
    )


class FalseRtk(Options):
    """Of false_rtk."""

    along_m: float = Field(0.0, description="m along the track")
    beside_m: float = Field(7.0, description="m to the right of the track")
    std_m: Positive = Field(0.02, description="the standard deviation that the receiver states, if it states one")


class Drag(Options):
    """Of drag."""

    rate_mps: float = Field(description="m/s along the track")
    with_speed: bool = Field(False, description="whether the receiver's speed goes with its position")


class Restamp(Options):
    """Of restamp."""

    age_s: Annotated[float, Field(gt=0.0, le=LONGEST_AGE_S)] = Field(20.0, description="age of the content, s")


class NoOptions(Options):
    """Of a fault that has none."""


def shifted(reading: Any, size: float, now: Moment) -> Any:
    """A reading that says `size` more, in its unit's measure."""
    if isinstance(reading, SpeedReading):
        if reading.speed_mps is None:
            bound = max(LEAST_BOUND_MPS, (reading.speed_max_mps or 0.0) + size)
            return reading.model_copy(update={"speed_max_mps": bound})
        return reading.model_copy(update={"speed_mps": reading.speed_mps + size})
    if isinstance(reading, InertialReading):
        forward, *others = reading.specific_force_mps2
        return reading.model_copy(update={"specific_force_mps2": [forward + size, *others]})
    return carried(reading, size, 0.0, now)


def scaled(reading: Any, factor: float) -> Any:
    """A reading whose speed, or forward force, is multiplied."""
    if isinstance(reading, InertialReading):
        forward, *others = reading.specific_force_mps2
        return reading.model_copy(update={"specific_force_mps2": [forward * factor, *others]})
    if reading.speed_mps is None:
        return reading.model_copy(update={"speed_max_mps": max(LEAST_BOUND_MPS, reading.speed_max_mps * factor)})
    return reading.model_copy(update={"speed_mps": reading.speed_mps * factor})


def carried(reading: PositionReading, along_m: float, beside_m: float, now: Moment) -> Any:
    """A position moved along the track, with its error, and to the right of it; beyond an end the track goes on straight."""
    track = now.around.line.track
    if track is None:
        raise ValueError("needs a line with geometry")
    at_m = track.project(reading.latitude_deg, reading.longitude_deg).position_m
    before, after = _place(track, at_m), _place(track, at_m + along_m)
    heading = math.radians(track.heading_deg(at_m + along_m))
    place = reading.latitude_deg + after[0] - before[0], reading.longitude_deg + after[1] - before[1]
    latitude, longitude = moved(*place, beside_m * math.cos(heading), -beside_m * math.sin(heading))
    return reading.model_copy(update={"latitude_deg": latitude, "longitude_deg": longitude})


def _place(track: Track, position_m: float) -> tuple[float, float]:
    inside = min(max(position_m, 0.0), track.length_m)
    heading, beyond = math.radians(track.heading_deg(inside)), position_m - inside
    return moved(*track.locate(inside), beyond * math.sin(heading), beyond * math.cos(heading))


def bias(options: Size, now: Moment, reading: Any) -> list[Sent]:
    """z + b."""
    return [Sent(shifted(reading, options.size, now))]


def ramp(options: Rate, now: Moment, reading: Any) -> list[Sent]:
    """z + r t, t the time since the onset."""
    return [Sent(shifted(reading, options.rate * now.since_s, now))]


def scale(options: Factor, now: Moment, reading: Any) -> list[Sent]:  # noqa: ARG001
    """k z."""
    return [Sent(scaled(reading, options.factor))]


def intermittent(options: Intermittent, now: Moment, reading: Any) -> list[Sent]:
    """z + b for the first part of every period, z for the rest."""
    on = now.since_s % options.period_s < options.duty * options.period_s
    return [Sent(shifted(reading, options.size, now) if on else reading)]


def noise(options: Noise, now: Moment, reading: Any) -> list[Sent]:
    """Noise drawn from the seed and the reading's number: the same in every run. A bound without a value has none."""
    std = options.std or _std(reading, now)
    if std is None:
        return [Sent(reading)]
    label = f"{now.around.unit}.fault.{now.from_s!r}.{reading.sequence}"
    first, second = (options.factor * std * standard_normal(now.around.seed, label, 2)).tolist()
    if isinstance(reading, PositionReading):
        latitude, longitude = moved(reading.latitude_deg, reading.longitude_deg, first, second)
        return [Sent(reading.model_copy(update={"latitude_deg": latitude, "longitude_deg": longitude}))]
    return [Sent(shifted(reading, first, now))]


def _std(reading: Any, now: Moment) -> float | None:
    """The standard deviation that a reading states or, where it states none, that of its unit."""
    if isinstance(reading, SpeedReading):
        return None if reading.speed_variance_m2ps2 is None else math.sqrt(reading.speed_variance_m2ps2)
    if isinstance(reading, InertialReading):
        density = now.around.force_noise_mps2_rthz
        return None if density is None else density / math.sqrt(reading.mean_over_s)
    return reading.horizontal_std_m or now.around.position_std_m.get(reading.solution)


def creep(options: Spin | Slide, now: Moment, reading: Any) -> list[Sent]:
    """v (1 + c): c grows to the ratio, and falls again, within half a second."""
    share = min(1.0, now.since_s / CREEP_RAMP_S, (now.to_s - now.t_s) / CREEP_RAMP_S)
    return [Sent(scaled(reading, 1.0 + options.ratio * share))]


def false_rtk(options: FalseRtk, now: Moment, reading: PositionReading) -> list[Sent]:
    """A position beside the track that calls itself RTK-fixed, with the standard deviation of one."""
    stated = None if reading.horizontal_std_m is None else options.std_m
    wrong = carried(reading, options.along_m, options.beside_m, now)
    return [Sent(wrong.model_copy(update={"solution": "rtk_fixed", "horizontal_std_m": stated}))]


def drag(options: Drag, now: Moment, reading: PositionReading) -> list[Sent]:
    """The position, and with it the speed where asked, goes ahead of the train at a constant rate."""
    wrong = carried(reading, options.rate_mps * now.since_s, 0.0, now)
    if options.with_speed and reading.speed_mps is not None:
        wrong = wrong.model_copy(update={"speed_mps": reading.speed_mps + options.rate_mps})
    return [Sent(wrong)]


def stuck(options: NoOptions, now: Moment, reading: Any) -> list[Sent]:  # noqa: ARG001
    """The content of the last honest reading before the onset under this reading's head."""
    return [Sent(with_content_of(now.onset, reading))]


def restamp(options: Restamp, now: Moment, reading: Any) -> list[Sent]:
    """The newest reading that is at least so old, or the oldest there is, as if it were new, under another instance."""
    limit_ns = reading.measured_at_ns - round(options.age_s * 1e9)
    old = next((e for e in reversed(now.earlier) if e.measured_at_ns <= limit_ns), now.earlier[0])
    return [Sent(with_content_of(old, reading, instance=f"{reading.instance}-again"))]
