"""Scores of recordings: the error of dead reckoning when the satellites came back, and the true scales of the wheels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated

import numpy as np
from pydantic import BaseModel, Field

from milepost.config.train import Train
from milepost.config.yaml_files import ConfigError
from milepost.recordings.gnss_log import RecordedFix
from milepost.recordings.options import STRICT, Span
from milepost_schemas.reading import Solution

from .trace import Trace


class FixesOptions(BaseModel):
    """The fixes of a unit's recording; those within `untrusted_s` are false, whatever their solution."""

    model_config = STRICT
    unit: str
    untrusted_s: list[Span]


class ReacquiredOptions(FixesOptions):
    """Trustworthy fixes are those of a `solution`; more than `longer_than_s` between two of them is a gap."""

    solution: Solution = "rtk_fixed"
    longer_than_s: Annotated[float, Field(gt=0.0)] = 2.0


class UnitsOptions(BaseModel):
    """A score of several units."""

    model_config = STRICT
    units: list[str]


def check_recorded_unit(path: Path, field: str, train: Train, unit: str, stream: str) -> None:
    """Whether a unit replays a recording of a stream's messages. Raises ConfigError about the scenario file `path`."""
    if unit not in train.replayed_units:
        raise ConfigError(path, field, f"{unit} has no recording in {train.path}")
    if train.sensors[unit].stream != stream:
        raise ConfigError(path, field, f"{unit} records no {stream}, but {train.sensors[unit].stream}")


def replayed_fixes(train: Train, unit: str) -> list[RecordedFix]:
    """The fixes of a recording as the unit's sensor replays them, those included that are withheld from its filter.

    Raises ConfigError for a recording that cannot be read.
    """
    try:
        source = train.sensors[unit].source(None, 0.0)
        readings = [source.read() for _ in iter(source.next_s, None)]
    except (ValueError, OSError) as error:
        raise ConfigError(train.path, f"units.{unit}", str(error)) from error
    places = [(each.measured_s, each.fields) for each in readings if each is not None]
    return [RecordedFix(at, place["latitude_deg"], place["longitude_deg"], place["solution"]) for at, place in places]


def reacquired_error_m(trace: Trace, train: Train, options: ReacquiredOptions) -> list[float]:
    """How far the state was off at the first trustworthy fix after each gap, before it took that fix.

    |s + v t + a t²/2 - chainage of the fix|, [s, v, a] of the last epoch before the fix and t the time from there.
    """
    return [abs(error) for error, _ in _reacquired(trace, train, options)]


def reacquired_outside_interval(trace: Trace, train: Train, options: ReacquiredOptions) -> int | None:
    """The number of those fixes outside the published position interval."""
    if trace.bounds is None:
        return None
    out = 0
    for error, k in _reacquired(trace, train, options):
        low, high = trace.bounds[k, :2] - trace.states[k, 0]
        out += not low <= -error <= high
    return out


def _reacquired(trace: Trace, train: Train, options: ReacquiredOptions) -> Iterator[tuple[float, int]]:
    """(error, index of the epoch) of the first fix after each gap that ends within the trace."""
    track = train.line.track
    if track is None:
        raise ValueError("fixes need a line with geometry")
    # fixes that are withheld from the filter are a gap too
    left_out = [*options.untrusted_s, *train.sensors[options.unit].options.withhold_s]
    replayed = replayed_fixes(train, options.unit)
    fixes = [fix for fix in replayed if fix.solution == options.solution and not _within(fix.t_s, left_out)]
    for before, fix in pairwise(fixes):
        if fix.t_s - before.t_s <= options.longer_than_s or not trace.t_s[0] < fix.t_s <= trace.t_s[-1]:
            continue
        # an epoch at the fix's own time holds that fix
        k = int(np.searchsorted(trace.t_s, fix.t_s - 1e-6)) - 1
        t = fix.t_s - trace.t_s[k]
        s, v, a = trace.states[k]
        seen = track.project(fix.latitude_deg, fix.longitude_deg).position_m
        yield float(s + t * (v + 0.5 * t * a) - seen), k


def false_fixes_accepted(trace: Trace, train: Train, options: FixesOptions) -> int | None:  # noqa: ARG001
    """The number of untrusted fixes that reached the fuser as observations; None where no observation of the unit did."""
    counted = trace.counted.get(options.unit)
    return None if counted is None else sum(_within(t_s, options.untrusted_s) for t_s in counted.tolist())


def _within(t_s: float, spans: Sequence[Span]) -> bool:
    return any(a <= t_s < b for a, b in spans)


def recorded_scale(trace: Trace, train: Train, options: UnitsOptions) -> list[float]:
    """The true scale κ = Σv/Σz - 1 of each unit's recorded speeds z, v the true speed when they were read."""
    return [_recorded_scale(trace, train, unit) for unit in options.units]


def _recorded_scale(trace: Trace, train: Train, unit: str) -> float:
    source = train.sensors[unit].source(None, 0.0)
    rows: list[tuple[float, float]] = []
    while source.next_s() is not None:
        reading = source.read()
        if reading is not None and trace.t_s[0] <= reading.measured_s <= trace.t_s[-1]:
            rows.append((reading.measured_s, reading.fields["speed_mps"]))
    t, z = np.array(rows).T
    return float(np.interp(t, trace.t_s, trace.true_states[:, 1]).sum() / z.sum() - 1.0)
