"""Invariant 4 for radars of unknown scale and a loop that misses crossings: linearised at what their filters believe."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from milepost.config.train import load_train
from milepost.evaluation.run_log import RunLog
from milepost.offline.run import simulate

pytestmark = pytest.mark.long

RUNS, LENGTH_S, START_NS = 16, 4.0, 1_700_000_000_000_000_000
BODY = {"body_pitch_std_deg": 0.3}
DROPOUTS = {"dropout_rate_hz": 0.5, "dropout_mean_s": 1.0}
# the radar speaks at t = 0, where the prior is true: it sits at the first reading
TRAIN = {
    "prior": {"speed_mps": 60.0, "speed_std_mps": 2.0},
    "fusion": {"shares": {"radar": 0.4, "loop": 0.3, "janus": 0.3}},
    "units": {
        "radar": {"scale_std": 0.03, "noise_ratio": 0.002, "rate_hz": 40.0, **BODY},
        "janus": {"kind": "janus_radar", "scale_std": 0.002, "mounting_pitch_deg": 0.5, **BODY, **DROPOUTS},
        "loop": {"missed_probability": 0.005, "rate_hz": 20.0, "joint_every_m": 40.0},
    },
}


def settled_nees(seed: int) -> list[float]:
    """NEES of the settled [s, v, a] before and after the first balise, which comes at about 1.7 s."""
    motion = {"driver_time_s": None, "profile": [[0.0, 60.0]], "start_std": [0.5, 2.0, 0.01]}
    train = load_train(Path("deploy/trains/maglev.yaml"), {**TRAIN, "world": {"seed": seed, "motion": motion}})
    log = RunLog(train)
    simulate(train, LENGTH_S, log.tap, log.keep)
    out = []
    for at_s in (1.0, 3.5):
        at = START_NS + round(at_s * 1e9)
        state, truth = log.settled[at], log.truth[at]
        P = np.array(state.covariance)
        scale = np.sqrt(np.diag(P))
        e = (np.array([state.position_m, state.speed_mps, state.acceleration_mps2]) - truth) / scale
        out.append(float(e @ np.linalg.solve(P / np.outer(scale, scale), e)))
    return out


@pytest.fixture(scope="module")
def nees() -> np.ndarray:
    """Sixteen trains."""
    return np.array([settled_nees(9000 + i) for i in range(RUNS)])


@pytest.mark.parametrize("at", [0, 1])
def test_the_fused_state_is_consistent(nees: np.ndarray, at: int) -> None:
    """The mean of 16 chi-squares of 3 degrees has a standard deviation of √(6/16) = 0.61; its upper tail is heavier."""
    assert 3.0 - 2.5 * math.sqrt(6.0 / RUNS) < nees[:, at].mean() < 3.0 + 3.0 * math.sqrt(6.0 / RUNS)
