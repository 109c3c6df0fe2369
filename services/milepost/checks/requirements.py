"""THE TABLE OF CHECKS: what SUBSET-041, LOC-OB and OC-7244 ask of each published state, and what Milepost says of itself.

Three things are kept apart: a truth outside the interval is unsafe (`position_interval`, `speed_interval`); an estimate that
errs by more than a requirement permits is inaccurate; an interval that is wider than a requirement permits is unavailable.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from .published import Array, Flags, Published

KMH = 1.0 / 3.6
POSITION, SPEED = 0, 1
REAR, FRONT = 0, 1
# LOC-OB states 95.4 %, two standard deviations; `accuracy` is of 95 %
FROM_95_TO_95_4 = 2.0 / 1.959964
# the trapezoid and the coordinates round
ROUNDING_M = 1e-6


@dataclass(frozen=True)
class Found:
    """What a check sees in the N epochs that it applies to; None where it asks for no such thing.

    `beyond` (N): how far an epoch is beyond what is permitted, at most 0 where it is not. `size` (N): a width, or a step.
    `available` (N): whether the width is permitted.
    """

    beyond: Array | None = None
    size: Array | None = None
    available: Flags | None = None


@dataclass(frozen=True)
class Check:
    """A row: what it looks at (None where the estimator has no such thing), the unit of its figures and the name of its sizes.

    `always`: it applies everywhere; otherwise a scenario requests it, within the window in which it applies.
    """

    look: Callable[[Published], Found | None]
    unit: str
    size: str = "width"
    always: bool = True


def subset_041_reach_m(since_balise_m: Any) -> Any:
    """SUBSET-041 5.3.1.1: over- and under-reading at most 5 m + 5 % of the distance since the reference balise."""
    return 5.0 + 0.05 * abs(since_balise_m)


def speed_law_mps(speed_mps: Array) -> Array:
    """SUBSET-041 5.3.1.2: ±2 km/h below 30 km/h, from there linear to ±12 km/h at 500 km/h, and no more beyond."""
    return np.interp(np.abs(speed_mps), [30.0 * KMH, 500.0 * KMH], [2.0 * KMH, 12.0 * KMH])


def loc_ob_speed_mps(speed_mps: Array) -> Array:
    """LOC-OB: ±1 km/h up to 100 km/h, from there ±1 %."""
    permitted: Array = np.maximum(1.0 * KMH, 0.01 * np.abs(speed_mps))
    return permitted


def _true(p: Published, column: int) -> Array:
    assert p.truth is not None
    return p.truth[:, column]


def _errors(p: Published, column: int) -> Array:
    errors: Array = np.abs(p.states[:, column] - _true(p, column))
    return errors


def _interval(p: Published, column: int) -> Array:
    assert p.bounds is not None
    return p.bounds[:, 2 * column : 2 * column + 2]


def _reach(p: Published, column: int) -> Array:
    """The larger of over- and under-reading: how far the interval reaches from the estimate."""
    reach: Array = np.abs(_interval(p, column) - p.states[:, [column]]).max(axis=1)
    return reach


def _found(p: Published, beyond: Array | None, width: Array, permitted: Array | float) -> Found:
    """A lost state is unavailable, however wide its interval is."""
    lost = np.zeros(len(width), dtype=bool) if p.lost is None else p.lost
    return Found(beyond, width, (width <= permitted) & ~lost)


def truth_in_interval(p: Published, column: int) -> Found:
    """The truth lies in the published interval."""
    (low, high), true = _interval(p, column).T, _true(p, column)
    return Found(np.maximum(low - true, true - high), high - low)


def truth_in_accuracy(p: Published, column: int) -> Found | None:
    """The error stays within the stated accuracy without faults: at 95 % of the epochs."""
    if p.accuracy is None:
        return None
    return Found(_errors(p, column) - p.accuracy[:, column], p.accuracy[:, column])


def subset_041_position(p: Published) -> Found | None:
    """SUBSET-041 5.3.1.1: error and reach at most 5 m + 5 % of the distance since the last balise.

    The location accuracy of that balise comes on top of either (SUBSET-026 3.6.4). Epochs before the first balise have no
    such distance and do not count.
    """
    if p.since_balise_m is None or p.location_accuracy_m is None:
        return None
    permitted = subset_041_reach_m(p.since_balise_m) + p.location_accuracy_m
    found = _found(p, _errors(p, POSITION) - permitted, _reach(p, POSITION), permitted)
    return _where(np.isfinite(permitted), found)


def subset_041_speed(p: Published) -> Found:
    """SUBSET-041 5.3.1.2: the error within the law at the true speed, the reach within it at the estimated one."""
    beyond = _errors(p, SPEED) - speed_law_mps(_true(p, SPEED))
    return _found(p, beyond, _reach(p, SPEED), speed_law_mps(p.states[:, SPEED]))


def loc_ob_position(p: Published, permitted_m: float) -> Found | None:
    """LOC-OB: at 95.4 % of the epochs the error is permitted; so must be the accuracy that is stated, at 95.4 %."""
    if p.accuracy is None:
        return None
    width = FROM_95_TO_95_4 * p.accuracy[:, POSITION]
    return _found(p, _errors(p, POSITION) - permitted_m, width, permitted_m)


def loc_ob_speed(p: Published) -> Found | None:
    """The same of the speed."""
    if p.accuracy is None:
        return None
    beyond = _errors(p, SPEED) - loc_ob_speed_mps(_true(p, SPEED))
    width = FROM_95_TO_95_4 * p.accuracy[:, SPEED]
    return _found(p, beyond, width, loc_ob_speed_mps(p.states[:, SPEED]))


def loc_ob_safe_interval(p: Published, permitted_m: float, permitted_s: float) -> Found:
    """LOC-OB: the safe interval is at most so many metres wide, or so many seconds of travel where that is more."""
    low, high = _interval(p, POSITION).T
    return _found(p, None, high - low, np.maximum(permitted_m, permitted_s * np.abs(p.states[:, SPEED])))


def oc_7244(p: Published, end: int) -> Found | None:
    """OC-7244: from epoch to epoch the safe rear or front advances at most as far as the train travelled, by its estimate."""
    if p.steps_m is None:
        return None
    step = p.steps_m[:, end]
    return _where(np.isfinite(step), Found(np.where(step > ROUNDING_M, step, 0.0), np.maximum(step, 0.0)))


def position_stamp(p: Published) -> Found | None:
    """The stamps of published positions never go back."""
    return None if p.stamps_s is None else Found(-np.diff(p.stamps_s))


def _where(applies: Flags, found: Found) -> Found:
    beyond, size = (None if each is None else each[applies] for each in (found.beyond, found.size))
    return Found(beyond, size, None if found.available is None else found.available[applies])


CHECKS: dict[str, Check] = {
    "position_interval": Check(partial(truth_in_interval, column=POSITION), "m"),
    "speed_interval": Check(partial(truth_in_interval, column=SPEED), "mps"),
    "position_accuracy": Check(partial(truth_in_accuracy, column=POSITION), "m"),
    "speed_accuracy": Check(partial(truth_in_accuracy, column=SPEED), "mps"),
    "subset_041_position": Check(subset_041_position, "m"),
    "subset_041_speed": Check(subset_041_speed, "mps"),
    "loc_ob_position": Check(partial(loc_ob_position, permitted_m=5.0), "m"),
    "loc_ob_speed": Check(loc_ob_speed, "mps"),
    "loc_ob_safe_interval": Check(partial(loc_ob_safe_interval, permitted_m=30.0, permitted_s=1.0), "m"),
    "loc_ob_node_position": Check(partial(loc_ob_position, permitted_m=1.0), "m", always=False),
    "loc_ob_node_safe_interval": Check(partial(loc_ob_safe_interval, permitted_m=10.0, permitted_s=0.0), "m", always=False),
    "oc_7244_rear": Check(partial(oc_7244, end=REAR), "m", "step"),
    "oc_7244_front": Check(partial(oc_7244, end=FRONT), "m", "step"),
    "position_stamp": Check(position_stamp, "s"),
}
