"""How the axes of an inertial unit lie, as gravity and the train's speed show."""

from __future__ import annotations

import math
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
# two axes that both follow the speed, and surely, share it; what a curve adds does not follow it as surely
MOST_ASKEW_DEG, SURE_CORRELATION = 15.0, 0.7


def inertial_parts(columns: Sequence[Column], rows: Rows, t_s: Array, speed_mps: Array) -> dict[str, list[Part]]:
    """The fields of an inertial reading, with axes turned to forward, right, down; `t_s`, `speed_mps`: of the train.

    Down is the axis that feels gravity, forward that of the other two which follows the speed; the third follows from these,
    for the three are right-handed. Raises ValueError with the reason where no axes are these.
    """
    named = {column.field: column for column in columns}
    missing = [axis for axis in AXES if f"accel_{axis}" not in named]
    if missing:
        raise ValueError(f"it has no acceleration {', '.join(missing)}")
    felt = [float(np.nanmean(rows.values[f"accel_{axis}"])) for axis in AXES]
    down = int(np.argmax(np.abs(felt)))
    if not LEAST_GRAVITY <= abs(felt[down]) <= MOST_GRAVITY:
        most = f"{felt[down]:.2f} m/s2 in the mean at most"
        raise ValueError(f"none of its axes feels gravity: {most} (units: --unit accel_down=g)")
    # the share of the speed's changes that an axis feels: an axis that feels none may agree with anything by chance
    followed = {at: _follows(rows, AXES[at], t_s, speed_mps) for at in range(3) if at != down}
    forward = max(followed, key=lambda at: abs(followed[at][0]))
    share, agreement = followed[forward]
    if agreement < LEAST_CORRELATION:
        raise ValueError(f"none of its axes follows the train's speed: correlation {agreement:.2f} at most")
    right = 3 - down - forward
    askew_deg = math.degrees(math.atan2(abs(followed[right][0]), abs(share)))
    if askew_deg > MOST_ASKEW_DEG and followed[right][1] >= SURE_CORRELATION:
        raise ValueError(f"none of its axes points ahead: it is about {askew_deg:.0f} degrees askew")
    ahead, below = np.sign(share), -np.sign(felt[down])
    # the determinant of the turned axes stays 1; that of their order is 1 for forward, right, down and its rotations
    order = 1.0 if (right - forward) % 3 == 1 else -1.0
    turned = [(AXES[forward], ahead), (AXES[right], ahead * below * order), (AXES[down], below)]
    parts = {"specific_force_mps2": [Part(f"accel_{axis}", named[f"accel_{axis}"], sign) for axis, sign in turned]}
    if all(f"gyro_{axis}" in named for axis in AXES):
        parts["turn_rate_radps"] = [Part(f"gyro_{axis}", named[f"gyro_{axis}"], sign) for axis, sign in turned]
    return parts


def _follows(rows: Rows, axis: str, t_s: Array, speed_mps: Array) -> tuple[float, float]:
    """The slope of an axis's accelerations over the changes of speed, and the size of their correlation; 0 if unknown."""
    edges = np.arange(max(t_s[0], rows.t_s[0]), min(t_s[-1], rows.t_s[-1]), COMPARED_S)
    at = np.searchsorted(rows.t_s, edges)
    means = np.array([float(np.mean(rows.values[f"accel_{axis}"][a:b])) if b > a else np.nan for a, b in pairwise(at)])
    changes = np.diff(np.interp(edges, t_s, speed_mps)) / COMPARED_S
    known = np.isfinite(means)
    if np.count_nonzero(known) < LEAST_COMPARED:
        return 0.0, 0.0
    (felt, both), (_, moved) = np.cov(means[known], changes[known])
    if felt <= 0.0 or moved <= 0.0:
        return 0.0, 0.0
    return float(both / moved), float(abs(both) / np.sqrt(felt * moved))
