"""The H∞ step by hand, its limit, its existence condition, and what it does not touch."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from milepost.estimation.estimator import Prior
from milepost.estimation.filters.base import FilterSetup
from milepost.estimation.filters.h_infinity import HInfinityFilter, HInfinityOptions
from milepost.estimation.filters.kalman import KalmanFilter, KalmanOptions
from milepost.estimation.h_infinity import HInfinityKernel, bounded_update
from milepost.estimation.kalman import ArrayKernel, update
from milepost.estimation.layout import Layout, PrivateState
from milepost.estimation.observation import Observation
from milepost.estimation.time_units import NS_PER_S

T0 = 1_000 * NS_PER_S
SETUP = FilterSetup(Layout(), 1e-2, Prior(np.array([0.0, 20.0, 0.0]), np.array([1.0, 2.0, 0.5])), 5 * NS_PER_S, 0.5)
SPEED = np.array([0.0, 1.0, 0.0])


def readings(count: int = 30) -> list[Observation]:
    rng = np.random.default_rng(3)
    return [
        Observation(T0 + k * NS_PER_S // 10, 0, k, "a", 0, "radar", (0.0, 1.0, 0.0), 20.0 + 0.2 * rng.normal(), 0.04)
        for k in range(count)
    ]


def test_a_step_by_hand():
    # P = 4, R = 4: the Kalman step leaves P = 2 and goes half way; then P⁻¹ = 1/2 - 1/(2² · 1²) = 1/4
    x, P = bounded_update(np.zeros(3), np.diag([1.0, 4.0, 1.0]), SPEED, 6.0, 4.0, SPEED[None, :], 2.0)
    np.testing.assert_allclose(x, [0.0, 3.0, 0.0])
    np.testing.assert_allclose(P, np.diag([1.0, 4.0, 1.0]))


def test_a_bound_that_cannot_be_kept_has_no_filter():
    # after the step P = 2, so γ² must be above 2
    arguments = (np.zeros(3), np.diag([1.0, 4.0, 1.0]), SPEED, 6.0, 4.0, SPEED[None, :])
    assert bounded_update(*arguments, math.sqrt(2.0) - 1e-9) is None
    assert bounded_update(*arguments, math.sqrt(2.0) + 1e-6) is not None


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), gamma=st.floats(0.05, 5.0))
def test_it_exists_exactly_where_the_information_stays_positive(seed, gamma):
    rng = np.random.default_rng(seed)
    root, h, L = rng.normal(size=(4, 4)), rng.normal(size=4), rng.normal(size=(2, 4))
    P, R = root @ root.T + 0.1 * np.eye(4), 0.5
    information = np.linalg.inv(P) + np.outer(h, h) / R - L.T @ L / gamma**2
    least = np.linalg.eigvalsh(information)[0]
    if abs(least) < 1e-6:
        return
    taken = bounded_update(np.zeros(4), P, h, 1.0, R, L, gamma)
    assert (taken is not None) == (least > 0.0)
    if taken is not None:
        np.testing.assert_allclose(np.linalg.inv(taken[1]), information, rtol=1e-5, atol=1e-6 * np.abs(information).max())


def test_an_infinite_bound_is_the_kalman_filter():
    layout = Layout((("radar", (PrivateState("scale", 0.0, 0.01),)),))
    bounded = HInfinityKernel(layout, 1e-2, gamma=1e9, combinations=np.diag([1.0, 1.0, 0.0, 0.0])[:2])
    plain = ArrayKernel(layout, 1e-2)
    a = b = plain.pack(np.array([0.0, 20.0, 0.0, 0.0]), np.diag([1.0, 1.0, 0.1, 1e-4]))
    rng = np.random.default_rng(1)
    for _ in range(200):
        z = 20.0 + 0.2 * rng.normal()
        a = bounded.update(bounded.advance(a, 0.1), (0.0, 1.0, 0.0, 20.0), z, 0.04)
        b = plain.update(plain.advance(b, 0.1), (0.0, 1.0, 0.0, 20.0), z, 0.04)
    np.testing.assert_allclose(a[0], b[0], rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(a[1], b[1], rtol=1e-9, atol=1e-15)


def test_the_sources_combination_equals_a_kalman_filter_with_larger_noise():
    # H = L: P⁻¹ + (1 - γ⁻²)/R
    kernel = HInfinityKernel(Layout(), 1e-2, gamma=2.3)
    _, P = kernel.update((np.zeros(3), np.diag([1.0, 4.0, 1.0])), (0.0, 1.0, 0.0), 6.0, 0.5)
    assert 1.0 / P[1, 1] == pytest.approx(0.25 + (1.0 - 1.0 / 2.3**2) / 0.5)
    assert update(np.zeros(3), np.diag([1.0, 4.0, 1.0]), SPEED, 6.0, 0.5)[1][1, 1] < P[1, 1]


def test_what_it_passes_on_is_the_plain_reading_with_or_without_feedback():
    fed = HInfinityFilter(SETUP, HInfinityOptions(speed_scale_mps=0.5))
    unfed = KalmanFilter(SETUP, KalmanOptions())
    for o in readings():
        if o.sequence == 10:
            assert fed.estimator.accept_feedback(o.measured_at_ns - 1, np.array([3.0, 7.0, 1.0]), np.eye(3), 0.3)
        assert fed.take([o], o.measured_at_ns) == ([o], []) == unfed.take([o], o.measured_at_ns)


def step(local: HInfinityFilter, o: Observation) -> list[str]:
    local.take([o], o.measured_at_ns)
    assert local.estimator.state_at(o.measured_at_ns) is not None
    return [notice.code for notice in local.notices()]


def test_beginning_and_end_without_a_filter_are_reported_once():
    # the prior's speed is uncertain by 2 m/s over √β; one radar reading of 0.2 m/s makes it certain, a minute of silence not
    local = HInfinityFilter(SETUP, HInfinityOptions(gamma=1.0, speed_scale_mps=0.25))
    first = readings()
    vague = [o._replace(variance=100.0) for o in first[:3]]
    codes = [step(local, o) for o in [*vague, *first[3:8]]]
    assert codes == [["h_infinity_infeasible"], [], [], ["h_infinity_feasible"], [], [], [], []]


def test_where_there_is_no_filter_the_kalman_step_is_taken():
    local, plain = (
        HInfinityFilter(SETUP, HInfinityOptions(gamma=1.0, speed_scale_mps=1e-3)),
        KalmanFilter(SETUP, KalmanOptions()),
    )
    for o in readings():
        step(local, o)
        plain.take([o], o.measured_at_ns)
    at = readings()[-1].measured_at_ns
    for mine, theirs in zip(local.estimator.state_at(at), plain.estimator.state_at(at), strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("options", [{"gamma": 0.0}, {"gamma": math.nan}, {"position_scale_m": -1.0}])
def test_invalid_options_are_refused(options):
    with pytest.raises(ValueError, match=f"{next(iter(options))}: must be above 0"):
        HInfinityOptions(**options)
