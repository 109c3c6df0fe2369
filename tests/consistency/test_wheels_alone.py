"""Wheels alone: nothing measures their scale, so nothing of it may be learned, whatever the motion model says of the train."""

from __future__ import annotations

import math

import numpy as np
import pytest

from milepost.estimation.kalman import ArrayKernel
from milepost.estimation.layout import Layout
from milepost.estimation.scalar_private import PrivateScalarKernel
from milepost.sensors.observed import Belief
from milepost.sensors.odometer import odometer
from milepost.sensors.scale import SCALE, scaled_speed

HZ, SECONDS, R = 20.0, 60.0, 0.02**2
TRUE_JERK_PSD = 1e-3
SCALE_STD = 0.01
SEEDS = 8
WHEEL = odometer.PrivateState("scale", 0.0, SCALE_STD, scales_motion=True)
MEAN, COVARIANCE = [0.0, 15.0, 0.0], np.diag([1.0, 0.04, 0.01])


def speeds(seed: int, brakes: bool) -> list[float]:
    rng = np.random.default_rng(seed)
    v, a, out = 15.0 + 0.2 * rng.standard_normal(), 0.0, []
    for step in range(int(SECONDS * HZ)):
        a += math.sqrt(TRUE_JERK_PSD / HZ) * rng.standard_normal()
        if brakes and step in (20 * HZ, 30 * HZ):
            a += -0.8 if step == 20 * HZ else 0.8
        v += a / HZ
        out.append(v)
    return out


def drift(seed: int, jerk_psd: float, brakes: bool, wheels: int) -> float:
    """How far the first wheel's κ has moved after a minute, in its deviations."""
    layout = Layout(tuple((f"wheel-{number}", (WHEEL,)) for number in range(wheels)))
    kernel = PrivateScalarKernel(WHEEL, jerk_psd) if wheels == 1 else ArrayKernel(layout, jerk_psd)
    rng = np.random.default_rng(1000 + seed)
    scales = SCALE_STD * rng.standard_normal(wheels)
    P = np.diag([*np.diag(COVARIANCE), *[SCALE_STD**2] * wheels])
    state, settled = kernel.pack(np.array([*MEAN, *[0.0] * wheels]), P), 0.0
    for step, v in enumerate(speeds(seed, brakes)):
        state = kernel.advance(state, 1.0 / HZ)
        for number in range(wheels):
            unit = f"wheel-{number}"
            mean, P = kernel.unpack(state)
            own = list(layout.indices[unit])
            z = v / (1.0 + scales[number]) + math.sqrt(R) * rng.standard_normal()
            row = scaled_speed(z, R, Belief(mean[own], P[np.ix_(own, own)]), WHEEL)
            state = kernel.update(state, layout.lift(unit, row.row), row.value, row.variance)
        if step == 5 * HZ:
            settled = kernel.unpack(state)[0][SCALE]
    mean, P = kernel.unpack(state)
    return float(mean[SCALE] - settled) / math.sqrt(P[SCALE, SCALE])


@pytest.mark.parametrize("wheels", [1, 2])
@pytest.mark.parametrize("brakes", [False, True], ids=["steady", "brakes"])
@pytest.mark.parametrize("jerk_psd", [1e-3, 1.0, 50.0])
def test_a_scale_that_nothing_measures_stays(jerk_psd, brakes, wheels):
    drifts = [drift(seed, jerk_psd, brakes, wheels) for seed in range(SEEDS)]
    assert abs(np.mean(drifts)) < 0.05
    assert np.max(np.abs(drifts)) < 0.2
