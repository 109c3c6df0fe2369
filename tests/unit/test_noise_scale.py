"""Noise variances learned from innovations: the adaptive filter's mean and the robust filter's grid."""

from __future__ import annotations

import math
import random

import numpy as np
import pytest

from learners import Fed
from milepost.estimation.noise.adaptive import InnovationVariance
from milepost.estimation.noise.noise_scale import NoiseModel, NoiseScale

# two levels that never change and no outliers: everything can be computed by hand
STILL = NoiseModel(1.0, 3.0, levels=2, time_constant_s=1e9, outlier_share=1e-12)


def test_innovation_variance_by_hand():
    estimate = Fed(InnovationVariance(50, 0.05, start_weight=4.0), stated=2.0)
    # e² - c = 8 speaks for more than the present 2: it counts (8/9)² = 64/81; mean = 2 + (9 - 1 - 2) · (64/81)/(4 + 64/81)
    # = 2 + 384/388, stated with (n + 2)/n for n = 388/81
    n = 388.0 / 81.0
    assert estimate.take(3.0, 1.0)[1] == pytest.approx((2.0 + 384.0 / 388.0) * (n + 2.0) / n)


def test_innovation_variance_comes_to_the_truth_and_follows_it():
    rng = random.Random(1)
    estimate = Fed(InnovationVariance(50, 0.1), stated=1.0)
    for true in (9.0, 2.0):
        stated = []
        for k in range(1500):
            _, variance = estimate.take(rng.gauss(0.0, math.sqrt(true + 0.5)), 0.5)
            if k >= 500:
                stated.append(variance)
        # (n + 2)/n is 1.02; a mean over 1000 readings, with a memory of 50, errs by about √(2 · 1/1000) = 4.5 % of R + c
        assert np.mean(stated) == pytest.approx(1.02 * true, abs=3 * 0.045 * (true + 0.5))


def test_innovation_variance_does_not_fall_below_its_floor():
    estimate = Fed(InnovationVariance(10, 0.25), stated=1.0)
    assert min(estimate.take(0.0, 5.0)[1] for _ in range(100)) >= 0.25


def test_the_grids_weights_by_bayes():
    scale = Fed(NoiseScale(STILL), stated=1.0)
    scale.take(2.0, 1.0)
    # N(2; 0, 1 + 1) against N(2; 0, 1 + 9)
    likelihoods = np.array([math.exp(-4.0 / 4.0) / math.sqrt(2.0), math.exp(-4.0 / 20.0) / math.sqrt(10.0)])
    np.testing.assert_allclose(scale.memory.weights[0], likelihoods / likelihoods.sum(), rtol=1e-9)


def test_a_site_gives_the_exact_posteriors_two_moments():
    scale = Fed(NoiseScale(STILL), stated=1.0)
    c, e = 1.0, 1.0
    value, variance = scale.take(e, c)
    # the posterior of h x by numerical integration of N(h x; 0, c) · mixture likelihood with the prior weights a half each
    grid = np.linspace(-12.0, 12.0, 20_001)
    density = np.exp(-0.5 * grid**2 / c) * sum(np.exp(-0.5 * (e - grid) ** 2 / r) / math.sqrt(r) for r in (1.0, 9.0))
    density /= density.sum()
    mean = density @ grid
    gain = c / (c + variance)
    assert gain * value == pytest.approx(mean, rel=1e-6)
    assert c * (1.0 - gain) == pytest.approx(density @ (grid - mean) ** 2, rel=1e-6)
    assert scale.memory.weights.sum() == pytest.approx(1.0)


def std(scale: Fed) -> float:
    return float(scale.learner.std(scale.memory)[0])


def test_an_outlier_counts_little_and_does_not_raise_sigma():
    scale = Fed(NoiseScale(NoiseModel(0.2, 20.0)), stated=1.0)
    rng = random.Random(2)
    for _ in range(200):
        scale.take(rng.gauss(0.0, 2.0), 0.01, dt_s=0.2)
    before = std(scale)
    assert 1.4 < before < 2.8
    _, usual = scale.judge(1.0, 0.01)
    _, far = scale.take(30.0, 0.01)
    assert far > 30.0 * usual
    assert std(scale) < 1.5 * before


def test_sigma_is_followed_as_it_wanders():
    scale = Fed(NoiseScale(NoiseModel(0.2, 20.0)), stated=1.0)
    rng = random.Random(3)
    found = {}
    for true in (1.0, 8.0, 2.0):
        stds = []
        for k in range(300):
            scale.take(rng.gauss(0.0, true), 0.01, dt_s=0.2)
            if k >= 100:
                stds.append(std(scale))
        found[true] = float(np.median(stds))
    for true, median in found.items():
        assert 0.75 < median / true < 1.33


@pytest.mark.parametrize("dt_s", [0.001, 0.02, 1.0, 30.0, 1e4])
def test_wandering_keeps_probability_and_has_the_processs_moments(dt_s):
    scale = NoiseScale(NoiseModel(0.2, 20.0, levels=60))
    levels = np.linspace(math.log(0.2), math.log(20.0), 60)
    start = np.zeros((1, 60))
    start[0, 36] = 1.0
    (weights,) = scale.advance(scale.begin(np.ones(1))._replace(weights=start), dt_s).weights
    assert weights.sum() == pytest.approx(1.0)
    assert np.all(weights >= 0.0)
    mean = weights @ levels
    keep = math.exp(-dt_s / 20.0)
    assert mean == pytest.approx(levels.mean() + keep * (levels[36] - levels.mean()), abs=1e-3)
    # rare steps shorter than a level's width keep the variance exactly; the sampled Gaussian to a per cent
    assert weights @ (levels - mean) ** 2 == pytest.approx(0.36 * -math.expm1(-2.0 * dt_s / 20.0), rel=0.02)


@pytest.mark.parametrize("innovation", [0.0, 1e-300, 1e6, -1e12])
@pytest.mark.parametrize("variance", [1e-12, 1.0, 1e12])
def test_no_innovation_breaks_it(innovation, variance):
    scale = Fed(NoiseScale(NoiseModel(0.2, 20.0)), stated=1.0)
    value, taken = scale.take(innovation, variance)
    assert math.isfinite(value)
    assert taken > 0.0
    assert math.isfinite(taken)
    assert np.all(np.isfinite(scale.memory.weights))
