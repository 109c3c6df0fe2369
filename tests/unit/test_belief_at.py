"""What an estimator believes of a time before the feedback that it rests on."""

from __future__ import annotations

import numpy as np
import pytest

from milepost.estimation.estimator import Estimator, Prior
from milepost.estimation.layout import Layout, PrivateState
from milepost.estimation.time_units import NS_PER_S

SCALED = Layout((("odo", (PrivateState("scale", 0.0, 0.06, noise_psd=1e-4),)),))
MEAN = np.array([1000.0, 20.0, 0.5, 0.01])
P = np.diag([0.04, 0.01, 0.09, 1e-4])


def estimator(layout: Layout, share: float = 1.0) -> Estimator:
    return Estimator(layout, 0.01, Prior(np.zeros(3), np.ones(3)), 5 * NS_PER_S, share)


def test_without_observations_there_is_no_belief() -> None:
    assert estimator(SCALED).belief_at(NS_PER_S) is None


@pytest.mark.parametrize("share", [1.0, 0.25])
@pytest.mark.parametrize("states", [3, 4])
def test_a_belief_before_the_feedback_is_predicted_backwards(states: int, share: float) -> None:
    """0.1 s before: 1000 - 2 + 0.0025 m, 19.95 m/s. P_vv = 0.01 + 0.01² · 0.09 + q T³/3, whatever the share."""
    filter_ = estimator(SCALED if states == 4 else Layout())
    assert filter_.accept_feedback(10 * NS_PER_S, MEAN[:states], P[:states, :states], share)
    assert filter_.state_at(10 * NS_PER_S - NS_PER_S // 10) is None
    believed = filter_.belief_at(10 * NS_PER_S - NS_PER_S // 10)
    assert believed is not None
    mean, covariance = believed
    assert mean[:3] == pytest.approx([998.0025, 19.95, 0.5])
    assert covariance[1, 1] == pytest.approx(0.01 + 0.01 * 0.09 + 0.01 * 1e-3 / 3.0)
    assert covariance[2, 2] == pytest.approx(0.09 + 0.01 * 0.1)
    if states == 4:
        assert mean[3] == pytest.approx(0.01)
        assert covariance[3, 3] == pytest.approx(1e-4 + 1e-4 * 0.1)


def test_after_its_feedback_it_is_the_state_itself() -> None:
    filter_ = estimator(SCALED)
    filter_.accept_feedback(10 * NS_PER_S, MEAN, P, 1.0)
    for at in (10 * NS_PER_S, 10 * NS_PER_S + NS_PER_S // 5):
        believed, state = filter_.belief_at(at), filter_.state_at(at)
        assert believed is not None
        assert state is not None
        assert np.array_equal(believed[0], state[0])
        assert np.array_equal(believed[1], state[1])
