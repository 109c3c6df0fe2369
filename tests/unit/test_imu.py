"""The inertial unit: what gravity, curves and its own errors make of the motion, and what the filter makes of that."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import msgpack
import numpy as np
import pytest

from examples import T0, head, sensor, straight_line, world
from milepost.sensors.base import World
from milepost.sensors.imu.imu import GRAVITY_MPS2
from milepost.sensors.observed import Belief
from milepost.track.line import Line
from milepost_schemas import InertialReading, decode

QUIET = {
    "noise_density_mps2_rthz": 1e-9,
    "bias_std_mps2": 0.0,
    "turn_noise_density_radps_rthz": 0.0,
    "turn_bias_std_radps": 0.0,
}
SEEDS = 120
HILL = replace(straight_line(), gradient=((0.0, 0.0), (1000.0, 0.0), (2000.0, 0.02)))


def readings(options: dict[str, Any], of: World, count: int, from_s: float = 0.0) -> list[tuple[float, dict[str, Any]]]:
    source = sensor("imu", of.line, "imu", **options).open(of, from_s)
    taken = [source.read() for _ in range(count)]
    return [(m.measured_s, m.fields) for m in taken]


def belief(s: float, std: float = 1e-6, states: int = 4) -> Belief:
    covariance = np.eye(states) * 1e-12
    covariance[0, 0] = std**2
    return Belief(np.array([s, *[0.0] * (states - 1)]), covariance)


def test_at_rest_on_the_level_it_measures_gravity_alone() -> None:
    (_, fields), *_ = readings(QUIET, world([(0.0, 0.0)]), 1)
    assert fields["specific_force_mps2"] == pytest.approx([0.0, 0.0, -GRAVITY_MPS2], abs=1e-7)
    assert fields["turn_rate_radps"] == [0.0, 0.0, 0.0]


def test_a_reading_is_the_mean_acceleration_of_its_interval_true_at_the_middle() -> None:
    """From 10 to 20 m/s in 10 s: 1 m/s². At 20 Hz the first interval ends at 0.05 s."""
    (t, fields), *_ = readings(QUIET, world([(0.0, 10.0), (10.0, 20.0)]), 1)
    assert t == pytest.approx(0.025)
    assert fields["mean_over_s"] == pytest.approx(0.05)
    assert fields["specific_force_mps2"][0] == pytest.approx(1.0, abs=1e-6)


def test_a_climb_presses_forward_by_g_sine_of_the_gradient() -> None:
    """At 2500 m the slope is 2 %: g 0.02/√1.0004 = 0.19609 m/s²."""
    (_, fields), *_ = readings(QUIET, world([(0.0, 0.0)], start_m=2500.0, line=HILL), 1)
    assert fields["specific_force_mps2"][0] == pytest.approx(0.196094, abs=1e-5)
    assert math.hypot(*fields["specific_force_mps2"]) == pytest.approx(GRAVITY_MPS2)


def test_the_observation_is_free_of_gravity_where_the_gradient_is_known() -> None:
    unit = sensor("imu", HILL, "imu")
    reading = InertialReading(
        **head("imu"), specific_force_mps2=[0.696094, 0.0, -9.8], turn_rate_radps=[0.0] * 3, mean_over_s=0.05
    )
    ((row, value, variance),) = unit.observe(reading, belief(2500.0))
    assert row == (0.0, 0.0, 1.0, 1.0)
    assert value == pytest.approx(0.5, abs=1e-5)
    assert variance == pytest.approx(0.05**2 / 0.05)


def test_where_the_train_is_not_known_neither_is_the_gradient() -> None:
    """±100 m on a slope that grows by 2 % in 1 km: half the difference of g sin θ is g 0.002 = 0.0196 m/s²."""
    unit = sensor("imu", HILL, "imu")
    reading = InertialReading(**head("imu"), specific_force_mps2=[0.0, 0.0, -9.8], turn_rate_radps=[0.0] * 3, mean_over_s=0.05)
    ((_, _, variance),) = unit.observe(reading, belief(1500.0, 100.0))
    assert variance == pytest.approx(0.05 + 0.01961**2, rel=1e-3)


def test_hand_made_bytes_become_the_observation() -> None:
    """A payload as another language would pack it; f_x = 0.25 over 0.05 s: z = 0.25, R = 0.0025/0.05 = 0.05."""
    payload = msgpack.packb(
        {
            "train": "t", "unit": "imu", "instance": "i", "sequence": 3, "measured_at_ns": T0, "published_at_ns": T0 + 1,
            "specific_force_mps2": [0.25, 0.0, -9.8], "turn_rate_radps": [0.0, 0.0, 0.01], "mean_over_s": 0.05,
        }
    )  # fmt: skip
    reading = decode(payload, InertialReading)
    ((row, value, variance),) = sensor("imu", straight_line(), "imu").observe(reading, None)
    assert (row, value) == ((0.0, 0.0, 1.0, 1.0), 0.25)
    assert variance == pytest.approx(0.05)


def test_in_a_curve_it_measures_turn_rate_and_lateral_force() -> None:
    class Bend:
        def curvature(self, position_m: float) -> float:
            return 1.0 / 1000.0

    line = Line("bend", 10_000.0, (), track=Bend())  # type: ignore[arg-type]
    (_, fields), *_ = readings(QUIET, world([(0.0, 20.0)], line=line), 1)
    assert fields["specific_force_mps2"][1] == pytest.approx(400.0 / 1000.0, abs=1e-6)
    assert fields["turn_rate_radps"][2] == pytest.approx(0.02)


def test_white_noise_has_the_stated_density() -> None:
    """0.05 m/s²/√Hz over 0.05 s: std 0.2236; of 4000 readings the estimate of the variance has a std of √(2/4000)."""
    options = {**QUIET, "noise_density_mps2_rthz": 0.05}
    seen = np.array([f["specific_force_mps2"][0] for _, f in readings(options, world([(0.0, 0.0)], end_s=300.0), 4000)])
    assert np.var(seen) == pytest.approx(0.05, rel=4.0 * math.sqrt(2.0 / 4000))
    assert abs(np.corrcoef(seen[1:], seen[:-1])[0, 1]) < 4.0 / math.sqrt(4000)


@pytest.mark.slow
def test_the_bias_is_first_order_markov_with_the_stated_spread_and_memory() -> None:
    """Over 120 seeds: std 0.005 at the beginning and after 10 s; correlation between the two exp(-10/20) = 0.607."""
    options = {**QUIET, "bias_std_mps2": 0.005, "bias_time_constant_s": 20.0, "rate_hz": 2.0}
    pairs = []
    for seed in range(SEEDS):
        seen = readings(options, world([(0.0, 0.0)], seed=seed), 21)
        pairs.append((seen[0][1]["specific_force_mps2"][0], seen[20][1]["specific_force_mps2"][0]))
    first, later = np.array(pairs).T
    bound = 4.0 * math.sqrt(0.5 / SEEDS)
    assert np.std(first) == pytest.approx(0.005, rel=bound)
    assert np.std(later) == pytest.approx(0.005, rel=bound)
    assert np.corrcoef(first, later)[0, 1] == pytest.approx(math.exp(-0.5), abs=4.0 * (1.0 - math.exp(-1.0)) / math.sqrt(SEEDS))


def test_a_restarted_unit_goes_on_with_the_bias_and_noise_it_had() -> None:
    whole = readings({}, world(end_s=120.0), 2000)
    rest = readings({}, world(end_s=120.0), 3, from_s=60.0)
    assert rest == [entry for entry in whole if entry[0] > 59.97][:3]


def test_without_a_bias_in_the_model_there_is_no_private_state() -> None:
    for options in ({"bias_std_mps2": 0.0}, {"model_bias": False}):
        unit = sensor("imu", straight_line(), "imu", **options)
        assert unit.private_states == ()
    (state,) = sensor("imu", straight_line(), "imu").private_states
    assert (state.prior_std, state.time_constant_s) == (0.005, 900.0)
    assert state.noise_psd == pytest.approx(2.0 * 0.005**2 / 900.0)
