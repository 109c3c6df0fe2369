"""How the axes of an inertial unit lie, as gravity and the train's speed show."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np

from .columns import Column
from .rows import Array, Rows
from .value_source import Part

AXES = ("forward", "right", "down")
# the mean of the vertical axis on any track
LEAST_GRAVITY, MOST_GRAVITY = 8.0, 11.5
# accelerations are compared over this time; what agrees less with the speed is on another axis
COMPARED_S, LEAST_CORRELATION, LEAST_COMPARED = 2.0, 0.3, 5


def inertial_parts(columns: Sequence[Column], rows: Rows, t_s: Array, speed_mps: Array) -> dict[str, list[Part]]:
    """The fields of an inertial reading, with axes turned to forward, right, down; `t_s`, `speed_mps`: of the train.

    Raises ValueError with the reason where the columns cannot be the three axes of a unit that lies level.
    """
    named = {column.field: column for column in columns}
    missing = [axis for axis in AXES if f"accel_{axis}" not in named]
    if missing:
        raise ValueError(f"it has no acceleration {', '.join(missing)}")
    down = float(np.nanmean(rows.values["accel_down"]))
    if not LEAST_GRAVITY <= abs(down) <= MOST_GRAVITY:
        raise ValueError(f"its vertical axis does not feel gravity: {down:.2f} m/s2 in the mean (units: --unit accel_down=g)")
    up = 1.0 if down < 0.0 else -1.0
    agreement = _agreement(rows, t_s, speed_mps)
    if abs(agreement) < LEAST_CORRELATION:
        raise ValueError(f"its forward axis does not follow the train's speed: correlation {agreement:.2f}")
    forward = 1.0 if agreement > 0.0 else -1.0
    # two reversed axes reverse no third one: the three stay right-handed
    signs = {"forward": forward, "right": forward * up, "down": up}
    parts = {"specific_force_mps2": [Part(f"accel_{axis}", named[f"accel_{axis}"], signs[axis]) for axis in AXES]}
    if all(f"gyro_{axis}" in named for axis in AXES):
        parts["turn_rate_radps"] = [Part(f"gyro_{axis}", named[f"gyro_{axis}"], signs[axis]) for axis in AXES]
    return parts


def _agreement(rows: Rows, t_s: Array, speed_mps: Array) -> float:
    """The correlation of forward accelerations with the changes of speed."""
    edges = np.arange(max(t_s[0], rows.t_s[0]), min(t_s[-1], rows.t_s[-1]), COMPARED_S)
    at = np.searchsorted(rows.t_s, edges)
    means = [float(np.mean(rows.values["accel_forward"][a:b])) if b > a else np.nan for a, b in pairwise(at)]
    changes = np.diff(np.interp(edges, t_s, speed_mps)) / COMPARED_S
    known = np.isfinite(np.array(means))
    if np.count_nonzero(known) < LEAST_COMPARED or np.ptp(changes[known]) == 0.0:
        return 0.0
    return float(np.corrcoef(np.array(means)[known], changes[known])[0, 1])
