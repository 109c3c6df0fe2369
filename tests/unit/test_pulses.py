"""What an interval without a pulse says of the speed in its middle: within what a train can do, never anything false."""

from __future__ import annotations

import math

import numpy as np
import pytest

from examples import world
from milepost.sensors.pulses import Limits, PulseOptions, Silence, legs

LIMITS = Limits(1.5, 1.0)


@pytest.mark.parametrize(
    ("path_m", "interval_s", "bound_mps"),
    [(0.1, 0.2, 0.5 + 0.075), (0.1, 0.4, 0.25 + 0.15), (0.1, 0.6, math.sqrt(0.15)), (0.1, 60.0, math.sqrt(0.15))],
)
def test_a_bound_is_the_mean_and_what_acceleration_allows(path_m: float, interval_s: float, bound_mps: float) -> None:
    """d/Δ + A Δ/4 until 2 √(0.1/1.5) = 0.516 s, √(d A) = 0.387 m/s from then on: 20 s of silence say no more."""
    assert LIMITS.speed_bound(path_m, interval_s) == pytest.approx(bound_mps)
    assert LIMITS.path_m(bound_mps, interval_s) == pytest.approx(path_m)


@pytest.mark.parametrize("interval_s", [0.1, 0.3, 0.5164, 0.8])
def test_no_course_within_the_limits_exceeds_the_bound_and_one_attains_it(interval_s: float) -> None:
    """Random courses of |a| ≤ A, made as fast as a stretch of one pitch lets them; and the fastest, up and down at A."""
    rng, steps, d = np.random.default_rng(1), 80, 0.1
    h, bound, highest = interval_s / steps, LIMITS.speed_bound(d, interval_s), 0.0
    t, shifts = np.linspace(0.0, interval_s, steps + 1), bound * np.linspace(-8.0, 2.0, 2001)[:, None]
    courses = [np.repeat([1.0, -1.0], steps // 2), *(np.repeat(rng.choice([-1.0, 1.0], 8), steps // 8) for _ in range(200))]
    for course in courses:
        v = np.concatenate([[0.0], np.cumsum(1.5 * course) * h])
        s = np.concatenate([[0.0], np.cumsum(0.5 * (v[1:] + v[:-1])) * h])
        stays = np.ptp(s + shifts * t, axis=1) <= d
        if stays.any():
            highest = max(highest, v[steps // 2] + float(shifts[stays].max()))
    assert bound * 0.99 < highest <= bound * (1.0 + 1e-9)


def test_a_mean_speed_errs_by_the_jerk_where_that_matters() -> None:
    """J Δt²/24: 10.4 mm/s in half a second beside 20 mm/s; 0.1 mm/s in a twentieth, 3e-5 of the variance, is left out."""
    assert LIMITS.mean_variance(4e-4, 0.5) == pytest.approx(4e-4 + (0.25 / 24.0) ** 2)
    assert LIMITS.mean_variance(4e-4, 0.05) == 4e-4


def test_the_mean_of_a_course_is_the_speed_at_its_middle_up_to_the_jerk() -> None:
    """v = j t²/2 over [0, Δ]: mean j Δ²/6, middle j Δ²/8, apart by j Δ²/24."""
    j, interval_s = 1.0, 0.7
    assert j * interval_s**2 / 6.0 - j * interval_s**2 / 8.0 == pytest.approx(math.sqrt(LIMITS.mean_variance(0.0, interval_s)))


def test_a_bound_counts_as_its_mean_speed_uniform_and_the_jerk() -> None:
    """0.1 m in 1 s: 0.1²/3 + (1/24)², or another part of 0.1².

    At most b²/3, and that where Δ is not known.
    """
    b = LIMITS.speed_bound(0.1, 1.0)
    assert LIMITS.bound_variance(b, 1.0) == pytest.approx(0.01 / 3.0 + 1.0 / 576.0)
    assert LIMITS.bound_variance(b, 1.0, 0.25) == pytest.approx(0.01 / 4.0 + 1.0 / 576.0)
    assert LIMITS.bound_variance(b, 10.0) == pytest.approx(0.15 / 3.0)
    assert LIMITS.bound_variance(0.3, 0.0) == pytest.approx(0.03)


@pytest.mark.parametrize("path_m", [0.0267, 0.1, 1.3])
def test_a_window_is_as_long_as_says_most_in_a_given_time(path_m: float) -> None:
    """The variance of a bound times its window, the less the more said, is less than for windows a fifth shorter or longer."""

    def cost(window_s: float) -> float:
        return (path_m**2 / (3.0 * window_s**2) + (window_s**2 / 24.0) ** 2) * window_s

    best = LIMITS.window_s(path_m)
    assert best >= 2.0 * math.sqrt(path_m / 1.5)
    assert cost(best) < min(cost(0.8 * best), cost(1.2 * best))


def test_a_device_may_be_unheard_for_two_and_a_half_windows_on_a_train_that_came_from_rest() -> None:
    """0.1 m: 2.5 · 1.84 · 0.1^(1/3) = 2.14 s below √(2 · 1.5 · 0.1) = 0.548 m/s."""
    pause = LIMITS.pause(0.1)
    assert (pause.longest_s, pause.below_mps) == (pytest.approx(2.135, abs=1e-3), pytest.approx(0.5477, abs=1e-4))


def test_windows_lie_end_to_end_until_a_pulse_comes() -> None:
    """0.1 m: windows of 1.84 · 0.1^(1/3) = 0.854 s, at 20 Hz 0.9 s; each truly at its middle."""
    silence = Silence(2.0, 0.1, LIMITS)
    said = [m for i in range(41, 101) if (m := silence.bound(0.05 * i))]
    assert [(m.measured_s, m.fields["interval_s"]) for m in said] == [
        (pytest.approx(2.45 + 0.9 * n), pytest.approx(0.9)) for n in range(3)
    ]
    assert {m.fields["speed_max_mps"] for m in said} == {math.sqrt(0.15)}
    silence.broken(5.2)
    assert silence.bound(6.0) is None
    assert silence.bound(6.1) is not None


def test_after_bounds_only_the_rest_of_an_interval_is_a_value() -> None:
    """Pulse at 2, bounds until 3.8, the train then somewhere in a pitch: 0.1²/3 m²; from a pulse at 5.2 on, none of that."""
    silence = Silence(2.0, 0.1, LIMITS)
    assert silence.rest(2.0) == (2.0, 0.0)
    for i in range(41, 80):
        silence.bound(0.05 * i)
    assert silence.rest(2.0) == (pytest.approx(3.8), pytest.approx(0.01 / 3.0))
    assert silence.rest(5.2) == (5.2, 0.0)


def test_a_train_that_turns_round_splits_the_time_where_it_stands() -> None:
    """2 m/s at 0 s, -2 m/s at 20 s: it stands at 10 s."""
    motion = world([(0.0, 2.0), (20.0, -2.0)], end_s=20.0, start_m=100.0).motion
    ((t0, turn), (same, t1)) = legs(motion, 9.99, motion.at(9.99)[1], 10.04, motion.at(10.04)[1])
    assert (t0, t1) == (9.99, 10.04)
    assert turn == same == pytest.approx(10.0, abs=1e-6)
    assert legs(motion, 3.0, 1.4, 4.0, 1.2) == [(3.0, 4.0)]


def test_the_limits_are_an_emergency_brakes_unless_told() -> None:
    assert PulseOptions(kind="odometer").limits == LIMITS
    with pytest.raises(ValueError, match="acceleration_max_mps2"):
        PulseOptions(kind="odometer", acceleration_max_mps2=0.0)
