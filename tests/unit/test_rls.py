"""Recursive least squares, its smoothers, the particle swarm and the unscented transform."""

from __future__ import annotations

import random

import numpy as np
import pytest

from learners import Fed
from milepost.estimation.noise.pu_rls import ForgettingModel, SwarmTunedSmoother, Tuning
from milepost.estimation.noise.rls import ForgettingSmoother, Parabola, white_sum
from milepost.estimation.noise.swarm import Swarm
from milepost.estimation.noise.unscented import sigma_points, unscented_gain_terms


def parabola_over(times: list[float], values: list[float], forgetting: float, weights: list[float]) -> Parabola:
    parabola, before = Parabola.begin(1), times[0]
    for at, value, weight in zip(times, values, weights, strict=True):
        parabola, _ = parabola.advanced(at - before)
        parabola = parabola.taught(parabola.predicted(), np.array([value]), forgetting, np.array([weight]))
        before = at
    return parabola


def test_the_recursion_is_weighted_least_squares():
    rng = np.random.default_rng(4)
    times = np.cumsum(rng.uniform(0.1, 0.5, 25)).tolist()
    values, weights = (rng.normal(size=25) * 5.0).tolist(), rng.uniform(0.2, 2.0, 25).tolist()
    parabola = parabola_over(times, values, 0.9, weights)
    ages = np.array(times) - times[-1]
    X = np.stack([np.ones(25), ages, 0.5 * ages**2], axis=1)
    J = np.diag(0.9 ** np.arange(24, -1, -1) * weights)
    normal = X.T @ J @ X
    np.testing.assert_allclose(parabola.w[0], np.linalg.solve(normal, X.T @ J @ values), rtol=1e-4, atol=1e-4)
    np.testing.assert_allclose(parabola.P[0], np.linalg.inv(normal), rtol=1e-4, atol=1e-6)
    # and the variance of that, for readings of variance R/ω: N⁻¹ Xᵀ J (1/ω) J X N⁻¹
    J2 = J @ np.diag(1.0 / np.array(weights)) @ J
    sandwich = np.linalg.inv(normal) @ X.T @ J2 @ X @ np.linalg.inv(normal)
    np.testing.assert_allclose(parabola.V[0], sandwich, rtol=1e-4, atol=1e-6)


def test_a_step_by_hand():
    parabola = Parabola.begin(1)._replace(P=np.diag([0.9, 0.0, 0.0])[None], V=np.zeros((1, 3, 3)))
    # k = P x/(λ + xᵀP x) = 0.9/1.8; P ← (1 - k) P/λ
    after = parabola.taught(parabola.predicted(), np.array([4.0]), 0.9, np.ones(1))
    assert after.w[0, 0] == pytest.approx(2.0)
    assert after.P[0, 0, 0] == pytest.approx(0.5)


def test_a_parabola_follows_constant_acceleration_without_lag():
    smoother = Fed(ForgettingSmoother(0.9, 50), stated=1.0)
    for k in range(100):
        t = 0.2 * k
        smoothed, _ = smoother.take(5.0 + 20.0 * t + 0.4 * t * t, dt_s=0.2 if k else 0.0)
    assert smoothed == pytest.approx(5.0 + 20.0 * t + 0.4 * t * t, abs=1e-3)


def impulse_response(forgetting: float, length: int) -> np.ndarray:
    """What each of the last readings contributes to the smoothed one, newest first."""
    ages = -0.2 * np.arange(length)
    X = np.stack([np.ones(length), ages, 0.5 * ages**2], axis=1)
    J = forgetting ** np.arange(length)
    return np.linalg.solve((X.T * J) @ X, np.array([1.0, 0.0, 0.0])) @ (X.T * J)


def test_smoothing_adds_no_information():
    variance, correlation = white_sum(impulse_response(0.9, 300))
    assert variance < 0.35
    assert correlation > 3.0
    assert variance * correlation == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("kind", ["rls", "pu_rls"])
def test_the_noise_is_learned_and_the_smoothed_variance_is_right(kind):
    """Over blocks much longer than the memory, the mean of n smoothed readings errs by √(R_eff/n)."""
    rng = random.Random(5)
    smoother = smoother_of(kind)
    errors, stated = [], []
    for k in range(6000):
        smoothed, variance = smoother.take(rng.gauss(0.0, 3.0), dt_s=0.2)
        if k >= 1000:
            errors.append(smoothed)
            stated.append(variance)
    blocks = np.array(errors).reshape(50, 100).mean(axis=1)
    worth = 100.0 * float(np.mean(blocks**2))
    # fifty blocks: their mean square errs by √(2/50) = 20 %; three of those. Never overconfident by more than that
    assert 0.4 < worth / (1.0 / np.mean(1.0 / np.array(stated))) < 1.6
    assert np.median(stated) == pytest.approx(9.0, rel=0.25)
    assert np.var(errors) < 0.6 * 9.0


def smoother_of(kind: str) -> Fed:
    if kind == "rls":
        return Fed(ForgettingSmoother(0.9, 50), stated=1.0)
    return Fed(SwarmTunedSmoother(25, ForgettingModel(), Tuning(every=50)), stated=1.0)


@pytest.mark.parametrize("kind", ["rls", "pu_rls"])
def test_after_a_long_gap_the_smoother_restarts(kind):
    rng = random.Random(6)
    smoother = smoother_of(kind)
    for k in range(200):
        smoother.take(4.0 * k + rng.gauss(0.0, 1.0), dt_s=0.2)
    smoothed, variance = smoother.take(9_000.0, dt_s=150.0)
    assert smoothed == pytest.approx(9_000.0, abs=1e-3)
    assert 0.3 < variance < 3.0


def test_pu_rls_is_not_carried_away_by_outliers():
    found = {}
    for kind in ("rls", "pu_rls"):
        rng, smoother, errors = random.Random(7), smoother_of(kind), []
        for k in range(800):
            std = 20.0 if rng.random() < 0.05 else 2.0
            errors.append(smoother.take(4.0 * k + rng.gauss(0.0, std), dt_s=0.2)[0] - 4.0 * k)
        found[kind] = float(np.std(errors[100:]))
    assert found["pu_rls"] < 0.6 * found["rls"]


def test_the_forgetting_factor_is_long_while_still_and_short_while_not():
    model = ForgettingModel(degrees=4.0, longest=0.93)
    assert model.forgetting(0.0, 0.8, 1.0) == pytest.approx(0.93)
    # δ q = 4 · 4/(4 + 4) = 2: λ = 0.8 + 0.13/4
    assert model.forgetting(4.0, 0.8, 1.0) == pytest.approx(0.8325)
    assert model.weight(1.0) == pytest.approx(1.0)
    assert model.weight(96.0) == pytest.approx(0.05)


def test_the_swarm_finds_the_bottom_in_a_bounded_number_of_evaluations():
    swarm, evaluated = Swarm((0.0, -5.0), (1.0, 5.0), particles=8, seed=1), []

    def cost(p):
        evaluated.append(p[..., 0].size)
        return (p[..., 0] - 0.3) ** 2 + (p[..., 1] - 2.0) ** 2 / 100.0

    best, _ = swarm.search(swarm.begin(1), cost, np.array([1]), np.array([40]))
    assert sum(evaluated) == 8 * 41
    np.testing.assert_allclose(best[0], [0.3, 2.0], atol=0.05)


def test_the_swarm_stays_in_its_box():
    swarm, places = Swarm((0.0,), (1.0,), particles=5, seed=2), []
    swarm.search(swarm.begin(1), lambda p: places.append(p) or -p[..., 0], np.array([1]), np.array([20]))
    assert np.min(places) >= 0.0
    assert np.max(places) <= 1.0


def test_swarms_beside_one_another_find_what_each_finds_alone():
    swarm, bottoms, turns, generations = (
        Swarm((0.0,), (1.0,), 5, seed=3),
        np.array([0.2, 0.7]),
        np.array([1, 4]),
        np.array([2, 9]),
    )
    together, _ = swarm.search(swarm.begin(2), lambda p: (p[..., 0] - bottoms[:, None]) ** 2, turns, generations)
    for i in range(2):
        alone, _ = swarm.search(
            swarm.begin(1), lambda p, i=i: (p[..., 0] - bottoms[i]) ** 2, turns[i : i + 1], generations[i : i + 1]
        )
        np.testing.assert_array_equal(alone[0], together[i])


def test_pu_rls_is_deterministic_and_tunes_itself():
    tuning = Tuning(particles=4, generations=2, window=8, every=5)
    runs = []
    for _ in range(2):
        rng, smoother = random.Random(8), Fed(SwarmTunedSmoother(25, ForgettingModel(), tuning), stated=1.0)
        results = [smoother.take(4.0 * k + rng.gauss(0.0, 1.0), dt_s=0.2) for k in range(120)]
        runs.append((results, smoother.memory.best[0].tolist()))
    assert runs[0] == runs[1]
    assert runs[0][1] != [0.9, 0.2]


def test_the_unscented_gain_is_exact_where_the_observation_is_linear():
    rng = np.random.default_rng(9)
    root, h, mean = rng.normal(size=(3, 3)), rng.normal(size=3), rng.normal(size=3)
    P = root @ root.T + 0.1 * np.eye(3)
    y, cross, variance = unscented_gain_terms(mean, P, lambda points: points @ h)
    assert y == pytest.approx(h @ mean)
    np.testing.assert_allclose(cross, P @ h)
    assert variance == pytest.approx(h @ P @ h)


def test_the_unscented_mean_of_a_square_is_exact_where_a_linearisation_is_not():
    # E[x²] = x̂² + P = 4 + 0.25, where linearisation says 4
    y, cross, _ = unscented_gain_terms(np.array([2.0]), np.array([[0.25]]), lambda points: points[:, 0] ** 2)
    assert y == pytest.approx(4.25)
    np.testing.assert_allclose(cross, [2.0 * 2.0 * 0.25])


def test_sigma_points_by_hand():
    points = sigma_points(np.array([1.0, 2.0]), np.diag([4.0, 9.0]), 0.0)
    r = np.sqrt(2.0)
    np.testing.assert_allclose(points, [[1, 2], [1 + 2 * r, 2], [1, 2 + 3 * r], [1 - 2 * r, 2], [1, 2 - 3 * r]])
