"""The learned error equation: by hand, against a particle swarm, and what it is equivalent_white_variance in an outage."""

from __future__ import annotations

import math

import numpy as np
import pytest

from milepost.estimation.noise.swarm import Swarm
from milepost.sensors.imu.learned_error import InertialErrorModel, LearnedError, equivalent_white_variance

MODEL = InertialErrorModel(bias_std=0.005, walk_std=2.4e-4, noise_density=0.05)


def taught(learned: LearnedError, error: float, seconds: float, speed_error: float = 0.0, from_s: float = 0.0) -> int:
    """Readings at 10 Hz of a train that stands, all off by `error`; the fused speed is off by a constant."""
    count = 0
    for k in range(round(10.0 * seconds) + 1):
        count += learned.learn(from_s + 0.1 * k, 0.1, error, speed_error, 0.01, 0.0)
    return count


def test_one_sample_by_hand() -> None:
    """φ = (0.005, 0, 0), y = 0.01, R = 2.5e-5: Λ = 1 + 1, η = 2, A = 1: ε = 0.005 with variance 2.5e-5/2."""
    learned = LearnedError(InertialErrorModel(0.005, 0.0, 0.05))
    learned.fit(0.01, 2.5e-5, 0.0)
    assert learned.weights == pytest.approx([1.0, 0.0, 0.0])
    assert learned.correction(0.0) == (pytest.approx(0.005), pytest.approx(1.25e-5))


def test_forgetting_goes_back_to_the_data_sheet() -> None:
    """Λ = 2 → e⁻¹ 2 + (1 - e⁻¹) 1 + 0 with a sample that says nothing: 1.3679; η = e⁻¹ 2: A = 0.5379."""
    learned = LearnedError(InertialErrorModel(0.005, 0.0, 0.05, memory_s=60.0))
    learned.fit(0.01, 2.5e-5, 0.0)
    learned.fit(0.0, 1e9, 60.0)
    assert learned.information[0, 0] == pytest.approx(1.36788, abs=1e-5)
    assert learned.weights[0] == pytest.approx(0.537883, abs=1e-6)


def test_the_recursion_ends_where_a_swarm_would() -> None:
    """The cost J written out over all samples; 20 particles, 150 generations come to the same least value."""
    rng, learned, samples = np.random.default_rng(4), LearnedError(MODEL), []
    for _ in range(30):
        y, R = 0.008 + 0.016 * rng.normal(), 2.5e-4
        # a sample is fitted with the regressors as they stand when it comes
        psi = learned.memory.psi + 0.2 * (0.006 + 0.002 * rng.normal() - learned.memory.psi)
        learned.memory = learned.memory._replace(begun_s=0.0, learned_s=learned.memory.learned_s + 10.0, psi=psi)
        samples.append((learned.regressors(), y, R))
        learned.fit(y, R, 10.0)
    forget = math.exp(-10.0 / MODEL.memory_s)

    def cost(w: np.ndarray) -> float:
        n = len(samples)
        errors = sum(forget ** (n - 1 - i) * (y - float(phi @ w)) ** 2 / R for i, (phi, y, R) in enumerate(samples))
        return float(errors + w @ w)

    best = cost(learned.weights)
    swarm = Swarm([-3.0] * 3, [3.0] * 3, particles=20, seed=1)
    (found,), _ = swarm.search(swarm.begin(1), lambda w: np.array([[cost(p) for p in w[0]]]), np.array([1]), np.array([150]))
    assert cost(found) == pytest.approx(best, rel=1e-6)
    assert samples[-1][0] @ found == pytest.approx(samples[-1][0] @ learned.weights, abs=1e-5)
    for i in range(3):
        step = np.eye(3)[i] * 1e-3
        assert min(cost(learned.weights + step), cost(learned.weights - step)) > best


def test_a_fused_speed_that_is_off_by_a_constant_hides_no_bias() -> None:
    """The fusion follows an unknown bias, in speed by a constant: the samples contain all of the bias none the less."""
    errors = []
    for speed_error in (0.0, 0.7):
        learned = LearnedError(MODEL)
        assert taught(learned, 0.006, 400.0, speed_error) == 20
        errors.append(learned.correction(400.0)[0])
    assert errors[0] == errors[1]
    # 400 s leave N/√400 = 0.0025 of noise against a prior of 0.005: most of the bias is found
    assert 0.6 * 0.006 < errors[0] < 0.006


def test_the_learned_error_stays_in_an_outage_with_growing_variance() -> None:
    learned = LearnedError(MODEL)
    taught(learned, 0.006, 200.0)
    learned.pause()
    (then, c), (later, c_later), (_, c_end) = (learned.correction(t) for t in (200.0, 300.0, 1e6))
    assert then == later
    assert c_later - c == pytest.approx(100.0 * MODEL.walk_std**2)
    assert c_end - c == pytest.approx(MODEL.bias_std**2)


def test_a_gap_or_an_outage_drops_the_current_sample() -> None:
    learned = LearnedError(MODEL)
    assert taught(learned, 0.006, 9.0) == 0
    assert taught(learned, 0.006, 9.0, from_s=20.0) == 0
    learned.pause()
    assert taught(learned, 0.006, 9.0, from_s=29.1) == 0
    assert learned.correction(40.0)[0] == 0.0


def test_a_late_reading_and_two_lost_ones_keep_the_sample() -> None:
    learned, fits = LearnedError(MODEL), 0
    for k in range(402):
        if k % 50 in (20, 21):
            continue
        at = 0.1 * (k - 15 if k % 50 == 30 else k)
        fits += learned.learn(at, 0.1, 0.006, 10.0, 1e-6, 0.0)
    assert fits == int(40.0 // MODEL.window_s)


def test_before_learning_the_data_sheet_applies() -> None:
    assert LearnedError(MODEL).correction(0.0) == (0.0, pytest.approx(MODEL.bias_std**2))


def test_the_memory_is_as_long_as_the_walk_allows() -> None:
    assert InertialErrorModel(0.005, 2.5e-4, 0.05).memory_s == pytest.approx(200.0)
    assert InertialErrorModel(0.02, 1e-3, 0.01).memory_s == pytest.approx(60.0)
    assert InertialErrorModel(0.02, 0.0, 0.01).memory_s == 3600.0


def test_the_white_variance_spoils_a_position_as_the_constant_error_does() -> None:
    """c = 1e-4: after T = √(3 · 100/1) = 17.32 s R = 3 c T/Δ = 0.05196 at 10 Hz; integrated over T it makes c T⁴/4."""
    c, T, dt = 1e-4, math.sqrt(300.0), 0.1
    assert equivalent_white_variance(c, 100.0, 1.0, dt, 1e3) == pytest.approx(0.051962, abs=1e-6)
    times = (np.arange(1732) + 0.5) * T / 1732
    position_variance = float(np.sum((T - times) ** 2 * 3.0 * c * times) * T / 1732)
    assert position_variance == pytest.approx(c * T**4 / 4.0, rel=1e-5)
    assert equivalent_white_variance(c, 1e8, 1.0, dt, 100.0) == pytest.approx(3.0 * c * 100.0 / dt)
