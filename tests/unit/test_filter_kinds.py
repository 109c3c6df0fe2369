"""What every kind of local filter keeps to, and what those that learn may learn from."""

from __future__ import annotations

import math

import numpy as np
import pytest

from milepost.estimation.estimator import Prior
from milepost.estimation.filters import FILTERS
from milepost.estimation.filters.adaptive_kalman import AdaptiveKalmanFilter, AdaptiveKalmanOptions
from milepost.estimation.filters.base import FilterSetup, LocalFilter
from milepost.estimation.filters.learning import LearningFilter
from milepost.estimation.filters.pu_rls import PuRlsOptions
from milepost.estimation.filters.rls import RlsOptions
from milepost.estimation.filters.robust_kalman import RobustKalmanOptions
from milepost.estimation.layout import Layout, PrivateState
from milepost.estimation.observation import Observation
from milepost.estimation.time_units import NS_PER_S

T0 = 1_000 * NS_PER_S
PRIOR = Prior(np.array([0.0, 20.0, 0.0]), np.array([2.0, 0.5, 0.2]))
ALL = sorted(FILTERS)
LEARNING = [kind for kind in ALL if issubclass(FILTERS[kind], LearningFilter)]
BELIEF_FREE = sorted({"kalman", "h_infinity", "rls", "pu_rls"})


def built(kind: str, share: float = 1.0, layout: Layout | None = None) -> LocalFilter:
    row = FILTERS[kind]
    return row(FilterSetup(layout or Layout(), 1e-2, PRIOR, 5 * NS_PER_S, share), row.options_model())


def readings(count: int, seed: int = 1, std: float = 3.0) -> list[Observation]:
    """Positions at 5 Hz that state 1 m² and have nine."""
    rng = np.random.default_rng(seed)
    return [
        Observation(T0 + k * NS_PER_S // 5, 0, k, "a", 0, "gnss", (1.0, 0.0, 0.0), 4.0 * k + std * rng.normal(), 1.0)
        for k in range(count)
    ]


def passed_on(local: LocalFilter, observations: list[Observation]) -> list[Observation]:
    return [o for told in observations for o in local.take([told], told.measured_at_ns)[0]]


@pytest.mark.parametrize("kind", ALL)
def test_only_value_and_variance_of_an_observation_may_change(kind):
    told = readings(60)
    for before, after in zip(told, passed_on(built(kind), told), strict=True):
        assert after == before._replace(value=after.value, variance=after.variance)
        assert np.isfinite(after.value)
        assert 0.0 < after.variance < np.inf


@pytest.mark.parametrize("kind", ALL)
def test_a_filter_is_deterministic(kind):
    assert passed_on(built(kind), readings(60)) == passed_on(built(kind), readings(60))


@pytest.mark.parametrize("kind", BELIEF_FREE)
def test_what_these_pass_on_does_not_depend_on_feedback(kind):
    told, fed = readings(60), built(kind)
    out = []
    for o in told:
        out += fed.take([o], o.measured_at_ns)[0]
        fed.estimator.accept_feedback(o.measured_at_ns, np.array([7.0, 3.0, 1.0]), np.eye(3), 0.3)
    assert out == passed_on(built(kind), told)


@pytest.mark.parametrize("kind", LEARNING)
def test_nothing_is_learned_from_late_duplicate_or_untimely_readings(kind):
    told = readings(60)
    undisturbed, disturbed = built(kind), built(kind)
    expected, out = [], []
    for o in told:
        now = o.measured_at_ns
        expected += undisturbed.take([o], now)[0]
        out += disturbed.take([o], now)[0]
        if o.sequence % 7 == 6:
            assert disturbed.take([o._replace(value=1e6)], now)[1] == ["duplicate"]
            wild = o._replace(measured_at_ns=now + 10 * NS_PER_S, sequence=1000 + o.sequence, value=1e6)
            assert disturbed.take([wild], now)[1] == ["from_future"]
            old = o._replace(measured_at_ns=now - 10 * NS_PER_S, sequence=2000 + o.sequence, value=1e6)
            assert disturbed.take([old], now)[1] == ["too_old"]
    assert out == expected


@pytest.mark.parametrize("kind", LEARNING)
def test_a_late_reading_passes_with_the_learned_variance(kind):
    told, local = readings(100), built(kind)
    passed_on(local, told)
    late = told[-1]._replace(measured_at_ns=told[-1].measured_at_ns - NS_PER_S // 10, sequence=500, value=4.0 * 98.5)
    (taken,), refused = local.take([late], told[-1].measured_at_ns)
    assert not refused
    assert 3.0 < taken.variance < 27.0
    assert taken.value == pytest.approx(late.value, abs=3.0)
    next_reading = readings(101)[-1]
    undisturbed = built(kind)
    passed_on(undisturbed, told)
    after, without = (
        local.take([next_reading], next_reading.measured_at_ns),
        undisturbed.take([next_reading], next_reading.measured_at_ns),
    )
    # the belief has one reading more, the learner has not
    assert after[0][0].variance == pytest.approx(without[0][0].variance, rel=0.1)


@pytest.mark.parametrize("kind", LEARNING)
def test_the_components_of_a_reading_have_noise_of_their_own(kind):
    local = built(kind)
    rng = np.random.default_rng(2)
    for k, o in enumerate(readings(150)):
        speed = o._replace(component=1, row=(0.0, 1.0, 0.0), value=20.0 + 0.1 * rng.normal(), variance=1.0)
        counted, _ = local.take([o, speed], o.measured_at_ns)
        if k == 149:
            position, speed = counted
    assert position.variance > 2.0
    assert speed.variance < 0.5


@pytest.mark.parametrize("kind", LEARNING)
def test_a_variance_stated_nine_times_too_small_is_corrected(kind):
    stated = [o.variance for o in passed_on(built(kind), readings(200))[100:]]
    assert 5.0 < np.median(stated) < 16.0


def test_the_expectation_of_a_fed_belief_has_the_fused_variance():
    local = built("adaptive_kalman", share=0.25)
    mean, covariance = np.array([100.0, 20.0, 0.5]), np.diag([0.5, 0.1, 0.01])
    assert local.estimator.accept_feedback(T0, mean, covariance, 0.25)
    at, after = readings(1)[0], readings(6)[5]
    assert local.expected(at) == pytest.approx((100.0, 0.5))
    # a second later: 100 + 20 + 0.25; 0.5 + 0.1 + 0.01/4 + q/20
    assert local.expected(after) == pytest.approx((120.25, 0.5 + 0.1 + 0.0025 + 5e-4))


def test_a_reading_from_before_the_feedback_is_expected_from_it_backwards():
    local = built("adaptive_kalman", share=0.25)
    assert local.estimator.accept_feedback(T0 + NS_PER_S, np.array([100.0, 20.0, 0.5]), np.diag([0.5, 0.1, 0.01]), 0.25)
    value, variance = local.expected(readings(1)[0])
    assert value == pytest.approx(100.0 - 20.0 + 0.25)
    assert 0.6025 <= variance < 0.61


def test_before_anything_is_known_the_prior_is_expected():
    layout = Layout((("gnss", (PrivateState("offset", 1.5, 2.0),)),))
    local = built("robust_kalman", share=0.5, layout=layout)
    told = readings(1)[0]._replace(row=(1.0, 0.0, 0.0, 1.0))
    assert local.expected(told) == pytest.approx((1.5, 8.0))


@pytest.mark.parametrize(
    ("options", "wrong"),
    [
        (lambda: AdaptiveKalmanOptions(memory=0), "memory: must be above 0"),
        (lambda: RlsOptions(forgetting=1.0), "forgetting: must lie between 0 and 1"),
        (lambda: PuRlsOptions(longest=0.6), "longest: must be above 0.7"),
        (lambda: PuRlsOptions(window=2), "window: must lie between"),
        (lambda: RobustKalmanOptions(highest=0.1), "highest: must be above lowest"),
        (lambda: RobustKalmanOptions(levels=3), "levels: must lie between"),
        (lambda: RobustKalmanOptions(outlier_share=0.0), "outlier_share: must lie between 0 and 1"),
        (lambda: RobustKalmanOptions(highest=math.inf), "highest: must be above 0 and finite"),
        (lambda: RobustKalmanOptions(highest=math.nan), "highest: must be above 0 and finite"),
        (lambda: RobustKalmanOptions(outlier_ratio=0.1), "outlier_ratio: must be above 1"),
        (lambda: AdaptiveKalmanOptions(floor=math.inf), "floor: must be above 0 and finite"),
        (lambda: PuRlsOptions(seed=-1), "seed: must not be below 0"),
        (lambda: PuRlsOptions(particles=10**9), "particles: must be at most 100"),
    ],
)
def test_invalid_options_are_refused(options, wrong):
    with pytest.raises(ValueError, match=wrong):
        options()


def test_a_learning_filter_keeps_one_memory_for_each_component():
    local = built("adaptive_kalman")
    assert isinstance(local, AdaptiveKalmanFilter)
    passed_on(local, readings(300))
    assert len(local._learned) == 1
