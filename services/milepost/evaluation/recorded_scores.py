"""Scores of recordings: what dead reckoning was off when the satellites came back, and what the wheels' scales really were."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from typing import Annotated, Any

import numpy as np
from pydantic import BaseModel, Field

from milepost.config.train import Train
from milepost.recordings.gnss_log import RecordedFix, read_gnss_log
from milepost.recordings.options import STRICT, Span

from .trace import Trace


class FixesOptions(BaseModel):
    """The fixes of a unit's log; those within `untrusted_s` are false, whatever they call themselves."""

    model_config = STRICT
    unit: str
    untrusted_s: list[Span]


class ReacquiredOptions(FixesOptions):
    """Between trustworthy RTK fixes, more than `longer_than_s` is a gap."""

    longer_than_s: Annotated[float, Field(gt=0.0)] = 2.0


class UnitsOptions(BaseModel):
    """A score of several units."""

    model_config = STRICT
    units: list[str]


def reacquired_error_m(trace: Trace, train: Train, options: ReacquiredOptions) -> list[float]:
    """How far the state was off at the first trustworthy RTK fix after each gap, before it heard of that fix.

    |s + v t + a t²/2 - chainage of the fix|, [s, v, a] of the last epoch before the fix and t the time from there.
    """
    return [abs(error) for error, _ in _reacquired(trace, train, options)]


def reacquired_outside_interval(trace: Trace, train: Train, options: ReacquiredOptions) -> int | None:
    """How many of those fixes were outside the published position interval."""
    if trace.bounds is None:
        return None
    out = 0
    for error, k in _reacquired(trace, train, options):
        low, high = trace.bounds[k, :2] - (trace.truth[k, 0] + trace.errors[k, 0])
        out += not low <= -error <= high
    return out


def _reacquired(trace: Trace, train: Train, options: ReacquiredOptions) -> Iterator[tuple[float, int]]:
    """(error, place of the epoch) of the first fix after each gap that ends within the trace."""
    track = train.line.track
    if track is None:
        raise ValueError("fixes need a line with geometry")
    fixes = [fix for fix in _log(train, options) if fix.solution == "rtk_fixed" and not _false(fix.t_s, options)]
    for before, fix in pairwise(fixes):
        if fix.t_s - before.t_s <= options.longer_than_s or not trace.t_s[0] < fix.t_s <= trace.t_s[-1]:
            continue
        # an epoch at the fix's own time holds that fix
        k = int(np.searchsorted(trace.t_s, fix.t_s - 1e-6)) - 1
        t = fix.t_s - trace.t_s[k]
        s, v, a = trace.truth[k] + trace.errors[k]
        seen = track.project(fix.latitude_deg, fix.longitude_deg).position_m
        yield float(s + t * (v + 0.5 * t * a) - seen), k


def false_fixes_accepted(trace: Trace, train: Train, options: FixesOptions) -> int | None:  # noqa: ARG001
    """How many untrusted fixes reached the fuser as observations; None where nothing was counted."""
    counted = trace.counted.get(options.unit)
    return None if counted is None else sum(_false(t_s, options) for t_s in counted.tolist())


def _log(train: Train, options: FixesOptions) -> list[RecordedFix]:
    recording: Any = train.sensors[options.unit].options.recording
    return read_gnss_log(recording.file)


def _false(t_s: float, options: FixesOptions) -> bool:
    return any(a <= t_s < b for a, b in options.untrusted_s)


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
    return float(np.interp(t, trace.t_s, trace.truth[:, 1]).sum() / z.sum() - 1.0)
