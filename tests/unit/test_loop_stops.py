"""The loop through stops and reversals: pulses do not say which way, and silence says little, but nothing false."""

from __future__ import annotations

import math

import numpy as np
import pytest

from examples import all_readings, sensor, straight_line, world
from milepost.estimation.kalman import update
from milepost.recordings.measured import Measured
from milepost.sensors.base import World
from milepost.sensors.loop.antenna import Antenna
from milepost.sensors.loop.crossings import Crossings, Unseen
from milepost.sensors.loop.direction import SPEED, Reversals, signed
from milepost.sensors.observed import Belief
from milepost.simulation.motion import Profile, WhiteJerkMotion

PITCH = 0.1


def readings(on: World, kind: str = "induction_loop", **options: object) -> list[Measured]:
    return all_readings(sensor(kind, on.line, **options).open(on, 0.0))


def speeds(measured: list[Measured]) -> list[Measured]:
    return [m for m in measured if "speed_mps" in m.fields]


def bounds(measured: list[Measured]) -> list[Measured]:
    return [m for m in measured if "speed_max_mps" in m.fields]


def rolls_back(start_m: float) -> World:
    """A train that runs, rolls back, stands and runs again, braking at 0.5 m/s² with 0.25 m/s³."""
    corners = [(0.0, 3.0), (8.0, -1.0), (12.0, -1.0), (16.0, 0.0), (20.0, 0.0), (26.0, 3.0)]
    motion = WhiteJerkMotion(Profile(corners, start_m, 2.0), 26.0, 0.0, None, [0.0] * 3, 1)
    return World(motion, straight_line(), 1)


def shunted(seed: int) -> World:
    """A train pushed to and fro by up to 1.45 m/s², at 0.35 m/s and less, without regard to jerk."""
    rng, t, v = np.random.default_rng(seed), 0.0, 0.0
    corners = [(t, v)]
    while t < 60.0:
        dt = rng.uniform(0.1, 0.8)
        t, v = t + dt, float(np.clip(rng.uniform(-0.35, 0.35), v - 1.45 * dt, v + 1.45 * dt))
        corners += [(t, v)]
    return world(corners, end_s=60.0, start_m=500.0 + 0.01 * seed)


def test_a_train_that_rolls_backwards_is_heard_as_one_that_runs() -> None:
    """-1 m/s as 1 m/s: pulses do not say which way."""
    on = rolls_back(100.0)
    back = [m for m in speeds(readings(on, pitch_std_m=1e-9)) if 9.5 < m.measured_s < 10.5]
    assert len(back) > 8
    assert [m.fields["speed_mps"] for m in back] == pytest.approx([1.0] * len(back), rel=1e-3)


def test_an_antenna_hears_each_crossing_once_each_way() -> None:
    """2 m/s falling to -2 m/s in 4 s, 2 m each way and 20 crossings, whether or not the train turns within a window."""
    on = world([(0.0, 2.0), (4.0, -2.0)], end_s=4.0, start_m=100.05)
    for windows in (7, 40, 400):
        antenna = Antenna(Crossings(1, "loop", PITCH, 1e-9), Unseen(1, "loop.0", PITCH, 0.0, None, 1.0), on.motion, 0.0, 0.0)
        seen = [antenna.look(4.0 * i / windows, 4.0 * (i + 1) / windows) for i in range(windows)]
        assert sum(pulses.passed for pulses in seen if pulses is not None) == 40


@pytest.mark.parametrize("start_m", [100.0, 100.01, 100.05, 100.0999])
@pytest.mark.parametrize("rate_hz", [5.0, 20.0, 100.0])
def test_an_interval_with_a_reversal_holds_the_truth_within_its_variance(start_m: float, rate_hz: float) -> None:
    """Wherever the train turns round between two crossings, or on one: |z - |v|| < √3 σ, as uniform within n p/Δt."""
    on = rolls_back(start_m)
    for m in speeds(readings(on, pitch_std_m=1e-6, rate_hz=rate_hz)):
        off = m.fields["speed_mps"] - abs(on.motion.at(m.measured_s)[1])
        assert abs(off) < math.sqrt(3.0 * m.fields["speed_variance_m2ps2"]) + 1e-3


@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("induction_loop", {}),
        ("induction_loop", {"missed_probability": 0.05}),
        ("odometer", {}),
        ("odometer", {"timer_s": 1e-3}),
        ("odometer", {"timer_s": None, "jitter_s": 0.005}),
    ],
)
def test_no_bound_is_false_however_the_train_is_shunted(kind: str, options: dict[str, object]) -> None:
    """8 trains that turn round on edges and between them, in windows and between them."""
    wheel = {"simulated": {"diameter_m": 0.85}} if kind == "odometer" else {}
    count, closest = 0, 0.0
    for seed in range(8):
        on = shunted(seed)
        for m in bounds(readings(on, kind, rate_hz=20.0, **options, **wheel)):
            count += 1
            closest = max(closest, abs(on.motion.at(m.measured_s)[1]) / m.fields["speed_max_mps"])
    assert count > 40
    assert 0.1 < closest < 1.0


def test_a_long_silence_does_not_make_the_first_pulse_a_value_of_its_middle() -> None:
    """0.1 m in 20 s, z = 5 mm/s with σ = 0.11 mm/s, would be 45 σ off; what is left of the interval holds the truth."""
    on = world([(0.0, 2.0), (4.0, 0.0), (24.0, 0.0), (28.0, 2.0)], end_s=28.0, start_m=100.03)
    said = speeds(readings(on, rate_hz=20.0))
    first = next(m for m in said if m.measured_s > 10.0)
    assert first.measured_s > 23.5
    off = first.fields["speed_mps"] - on.motion.at(first.measured_s)[1]
    assert off**2 < 3.0 * first.fields["speed_variance_m2ps2"]


def test_reversal_is_excluded_where_the_train_was_too_fast_for_it() -> None:
    """0.1 m, 1.5 m/s²: a pulse each 0.1 s is 1 m/s, known from the second on; l = 1 - 0.075 m/s then excludes up to 0.6 s.

    Each 0.3 s, 0.33 m/s: l = 0.925 - 0.45 m/s, just enough for 0.3 s; then 0.475 - 0.45 is too little for the next.
    """
    reversals = Reversals(0.1, 1e-9, 1.5)
    assert [reversals.excluded(1, 0.1) for _ in range(4)] == [False, True, True, True]
    assert [reversals.excluded(1, 0.3) for _ in range(3)] == [True, True, False]
    # two pitches in 0.35 s are more than from standstill: 0.1 m > 0.092 m
    assert Reversals(0.1, 1e-9, 1.5).excluded(2, 0.35)
    assert not Reversals(0.1, 1e-9, 1.5).excluded(2, 0.37)
    # pitches that may be 5 σ off
    assert not Reversals(0.1, 0.00224, 1.5).excluded(2, 0.35)


def believed(v: float, std: float) -> Belief:
    return Belief(np.array([500.0, v, 0.0]), np.diag([1.0, std * std, 0.01]))


def test_the_belief_gives_a_pulse_its_direction() -> None:
    for v in (-2.0, 2.0):
        assert [tuple(o) for o in signed(2.1, 0.01, believed(v, 0.2))] == [(SPEED, math.copysign(2.1, v), 0.01)]
    assert signed(-2.1, 0.01, believed(2.0, 0.2))[0].value == -2.1


def test_a_pulse_of_unknown_direction_leaves_both() -> None:
    """0 ± 1 m/s and |v| = 0.5 ± 0.1: what remains is ± 0.5, mean 0, variance (0.5/1.01)² + 0.01/1.01; z = 0, 1/R = 1/that - 1.

    Once the belief is as sure as that, z² - R, it is no news any more, however often it is heard.
    """
    (seen,) = signed(0.5, 0.01, believed(0.0, 1.0))
    left = (0.5 / 1.01) ** 2 + 0.01 / 1.01
    assert seen.value == pytest.approx(0.0, abs=1e-12)
    assert seen.variance == pytest.approx(1.0 / (1.0 / left - 1.0))
    assert signed(0.5, 0.01, believed(0.0, math.sqrt(0.25 - 0.01))) == ()


def test_what_a_pulse_says_leaves_mean_and_variance_of_both_directions() -> None:
    """v̂ = 0.2 ± 0.5, |v| = 0.3 ± 0.1, by numbers: the density of v times that of both signs."""
    belief = believed(0.2, 0.5)
    (seen,) = signed(0.3, 0.01, belief)
    v = np.linspace(-4.0, 4.0, 80001)
    weight = np.exp(-((v - 0.2) ** 2) / 0.5) * (np.exp(-((v - 0.3) ** 2) / 0.02) + np.exp(-((v + 0.3) ** 2) / 0.02))
    weight /= weight.sum()
    mean = float(v @ weight)
    m, P = update(belief.mean, belief.covariance, np.array(SPEED), seen.value, seen.variance)
    assert m[1] == pytest.approx(mean, abs=1e-6)
    assert P[1, 1] == pytest.approx(float(((v - mean) ** 2) @ weight), rel=1e-5)
