"""The odometer: how its pulses err, which way it goes, how it wears and creeps, and how it observes the state."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from examples import T0, all_readings, head, sensor, straight_line, world
from milepost.recordings.measured import Measured
from milepost.sensors.base import World
from milepost.sensors.observed import Belief
from milepost.sensors.odometer.device import Wheel
from milepost_schemas import SpeedReading, decode, encode

TEN = {"rate_hz": 10.0}
PITCH = math.pi * 0.85 / 100.0  # of the default wheel


class Ratio:
    """A wheel with a given creep."""

    def __init__(self, ratio: Callable[[float], float]) -> None:
        self._ratio = ratio

    def at(self, unit: str, t_s: float) -> float:
        return self._ratio(t_s)


def creeping(on: World, ratio: Callable[[float], float]) -> World:
    return World(on.motion, on.line, on.seed, Ratio(ratio))


def exact(**options: Any) -> dict[str, Any]:
    """Options of a device without noise, on a wheel of the nominal diameter."""
    return {"speed_noise_std_mps": 1e-6, "simulated": {"diameter_m": 0.85}, **TEN, **options}


def readings(on: World, **options: Any) -> list[Measured]:
    return all_readings(sensor("odometer", on.line, **options).open(on, 0.0))


def errors(on: World, said: list[Measured]) -> np.ndarray:
    return np.array([m.fields["speed_mps"] - on.motion.at(m.measured_s)[1] for m in said])


# the devices -------------------------------------------------------------------------------------------------------------


@pytest.mark.slow
def test_counting_errs_by_its_quantisation_as_stated() -> None:
    """R = q²/4T²: q = 26.7 mm in T = 0.1 s. The speed sweeps a few hundred pulses, so that all phases occur: mean q²/6T².

    An error f(1-f) uniform in phase has a kurtosis below 3: the variance of 10 000 has a standard error below 2 %.
    """
    on = world([(0.0, 5.0), (1000.0, 25.0)], end_s=1000.0)
    said = readings(on, **exact(timer_s=None))
    R = PITCH**2 / (4.0 * 0.01)
    assert [m.fields["speed_variance_m2ps2"] for m in said] == pytest.approx([R] * len(said), rel=1e-6)
    assert len(said) == 10_000
    assert float(np.var(errors(on, said))) == pytest.approx(R / 1.5, rel=0.05)
    assert abs(float(np.mean(errors(on, said)))) < 1e-3


def test_counting_errs_by_no_more_than_stated_where_the_speed_stays() -> None:
    """At 4.5 pulses a period every count is 4 or 5: f(1-f) = 1/4."""
    on = world([(0.0, 45.0 * PITCH)], end_s=100.0)
    said = readings(on, **exact(timer_s=None))
    assert float(np.var(errors(on, said))) == pytest.approx(PITCH**2 / (4.0 * 0.01), rel=0.01)


def test_sampling_jitter_errs_as_stated_where_the_device_only_counts() -> None:
    """2/3 (0.003/0.1)² v² = 0.24 m²/s² at 20 m/s; the squares of 5000 sums of two uniform errors: 4 % at four sigma."""
    on = world(end_s=500.0)
    said = readings(on, **exact(timer_s=None, jitter_s=0.003, pulses_per_turn=100000))
    assert np.mean([m.fields["speed_variance_m2ps2"] for m in said]) == pytest.approx(0.24, rel=0.01)
    assert float(np.var(errors(on, said))) == pytest.approx(0.24, rel=0.06)


def test_samples_lie_within_the_jitter_of_their_grid_uniformly() -> None:
    """A uniform error within ±3 ms has a standard deviation of 1.732 ms."""
    on = world(end_s=300.0)
    source = sensor("odometer", on.line, **exact(jitter_s=0.003)).open(on, 0.0)
    off = []
    while (ready := source.next_s()) is not None:
        off.append(ready - 0.1 * round(ready / 0.1))
        source.read()
    assert len(off) >= 2999
    assert max(map(abs, off)) <= 0.003 + 1e-12
    assert float(np.std(off)) == pytest.approx(0.003 / math.sqrt(3.0), rel=0.04)
    assert abs(float(np.mean(np.square(off) > 0.0015**2)) - 0.5) < 0.04


def test_timed_edges_take_the_jitter_out() -> None:
    """With a timer of 1 µs only the mid-interval rule is left: nothing at constant acceleration."""
    on = world([(0.0, 5.0), (100.0, 25.0)], end_s=100.0)
    said = readings(on, **exact(jitter_s=0.003))
    assert len(said) > 990
    assert float(np.max(np.abs(errors(on, said)))) < 1e-3


@pytest.mark.slow
def test_a_coarse_timer_errs_as_stated() -> None:
    """v τ/(√6 Δt) = 0.082 m/s at 20 m/s, 1 ms and 0.1 s."""
    on = world([(0.0, 19.0), (1000.0, 21.0)], end_s=1000.0)
    said = readings(on, **exact(timer_s=1e-3))
    stated = float(np.mean([m.fields["speed_variance_m2ps2"] for m in said]))
    assert stated == pytest.approx((20.0 * 1e-3 / 0.1) ** 2 / 6.0, rel=0.02)
    assert float(np.var(errors(on, said))) == pytest.approx(stated, rel=0.06)


def test_white_noise_is_added_and_stated() -> None:
    on = world(end_s=500.0)
    said = readings(on, **exact(speed_noise_std_mps=0.05))
    assert said[0].fields["speed_variance_m2ps2"] == pytest.approx(0.0025, rel=1e-4)
    assert float(np.std(errors(on, said))) == pytest.approx(0.05, rel=0.05)


def test_a_wheel_wears_and_reads_ever_faster() -> None:
    """5 µm/s takes 0.5 mm off in 100 s; nominally 810 mm, truly 855.5 mm, 20 m/s reads as 18.94."""
    on = world(end_s=200.0)
    wheel = Wheel("odo", on, 0.856, 5e-6, 100)
    assert [wheel.diameter_m(t) for t in (0.0, 100.0)] == pytest.approx([0.856, 0.8555])
    said = readings(on, **exact(diameter_m=0.81, simulated={"diameter_m": 0.856, "wear_mps": 5e-6}))
    at_100 = min(said, key=lambda m: abs(m.measured_s - 100.0))
    assert at_100.fields["speed_mps"] == pytest.approx(20.0 * 0.81 / 0.8555, abs=1e-3)
    speeds = [m.fields["speed_mps"] for m in said]
    assert speeds[-1] - speeds[0] == pytest.approx(20.0 * 0.81 / 0.856 * 5e-6 * 200.0 / 0.856, rel=0.1)


def test_without_a_true_diameter_the_scale_is_drawn_from_the_prior() -> None:
    on = world(end_s=2.0)
    unit = sensor("odometer", on.line, scale_std=0.06, speed_noise_std_mps=1e-6)
    scale = on.true_value("unit", unit.private_states[0])
    assert 0.0 < abs(scale) < 0.3
    said = readings(on, scale_std=0.06, speed_noise_std_mps=1e-6, **TEN)
    assert said[-1].fields["speed_mps"] == pytest.approx(20.0 / (1.0 + scale), abs=1e-3)


def test_two_channels_tell_the_direction() -> None:
    """Forward, standing for a moment, and back again: the sign follows, and so does the distance."""
    on = world([(0.0, 2.0), (20.0, -2.0)], end_s=20.0, start_m=100.0)
    said = [m for m in readings(on, **exact()) if "speed_mps" in m.fields]
    assert said[0].fields["speed_mps"] > 1.9
    assert said[-1].fields["speed_mps"] < -1.9
    assert float(np.max(np.abs(errors(on, said)))) < 0.02
    counted = [m for m in readings(on, **exact(timer_s=None)) if "speed_mps" in m.fields]
    assert sum(m.fields["speed_mps"] * 0.1 for m in counted) == pytest.approx(0.0, abs=2.0 * PITCH)


def test_silence_gives_repeated_bounds() -> None:
    """Standing from 5 s on: 26.7 mm in windows of 1.84 · 0.0267^(1/3) = 0.55 s, read out each 0.1 s: 0.2 m/s each 0.6 s."""
    on = world([(0.0, 1.0), (5.0, 0.0), (30.0, 0.0)], end_s=30.0)
    said = [m for m in readings(on, **exact()) if "speed_max_mps" in m.fields]
    assert len(said) == 42
    assert [m.fields["interval_s"] for m in said[1:]] == pytest.approx([0.6] * 41)
    assert [m.fields["speed_max_mps"] for m in said] == pytest.approx([math.sqrt(PITCH * 1.5)] * 42)


def test_a_counting_device_gives_a_bound_for_each_count_of_zero() -> None:
    """26.7 mm in 0.1 s, in 94 ms with ± 3 ms of jitter, and what 1.5 m/s² allow meanwhile."""
    on = world([(0.0, 1.0), (5.0, 0.0), (30.0, 0.0)], end_s=30.0)
    for jitter_s in (0.0, 0.003):
        said = [m for m in readings(on, **exact(timer_s=None, jitter_s=jitter_s)) if m.measured_s > 5.2]
        assert len(said) == 248
        interval_s = 0.1 - 2.0 * jitter_s
        bound = PITCH / interval_s + 1.5 * interval_s / 4.0
        assert [m.fields["speed_max_mps"] for m in said] == pytest.approx([bound] * 248)


def test_counts_of_zero_and_one_weigh_alike_at_low_speed() -> None:
    """At 0.1 m/s three counts of four are none; taken as the filter takes them, all readings' mean is 0.1 m/s."""
    on = world([(0.0, 0.1)], end_s=1000.0)
    unit = sensor("odometer", on.line, **exact(timer_s=None))
    knows = Belief(np.zeros(4), np.diag([1.0, 1.0, 1.0, 1e-12]))
    said = [SpeedReading(**head(sequence=i), **m.fields) for i, m in enumerate(readings(on, **exact(timer_s=None)))]
    seen = [unit.observe(reading, knows)[0] for reading in said]
    weights = np.array([1.0 / o.variance for o in seen])
    assert float(np.array([o.value for o in seen]) @ weights / weights.sum()) == pytest.approx(0.1, rel=0.02)


def test_at_low_speed_bounds_and_values_add_up_to_the_distance() -> None:
    """At 30 mm/s a pulse takes 0.89 s: a bound for 0.6 s, and 26.7 mm for what is left, with 26.7²/3 mm² of doubt."""
    on = world([(0.0, 0.03)], end_s=300.0)
    said = [m for m in readings(on, **exact()) if "speed_mps" in m.fields][1:]
    assert sum(m.fields["speed_mps"] * m.fields["interval_s"] for m in said) == pytest.approx(9.0, abs=3.0 * PITCH)
    for m in said[:20]:
        dt = m.fields["interval_s"]
        assert m.fields["speed_variance_m2ps2"] == pytest.approx((PITCH / dt) ** 2 / 3.0, rel=0.01)


def test_a_wheel_that_turns_back_over_an_edge_counts_no_pulse() -> None:
    """Forward until 10 s, back again: pulses at the same edge are no way; sampled as rarely as each 0.2 s, the sum is right."""
    for start_m in (100.0, 100.004, 100.013):
        on = world([(0.0, 0.5), (20.0, -0.5)], end_s=20.0, start_m=start_m)
        said = [m for m in readings(on, **exact(rate_hz=5.0)) if "speed_mps" in m.fields]
        way = sum(m.fields["speed_mps"] * m.fields["interval_s"] for m in said)
        end_s = said[-1].measured_s + 0.5 * said[-1].fields["interval_s"]
        begin_s = said[0].measured_s - 0.5 * said[0].fields["interval_s"]
        assert way == pytest.approx(on.motion.at(end_s)[0] - on.motion.at(begin_s)[0], abs=2e-3)
        std = np.sqrt([m.fields["speed_variance_m2ps2"] for m in said])
        assert float(np.max(np.abs(errors(on, said)) / std)) < math.sqrt(3.0)


def test_a_creeping_wheel_reads_its_own_speed() -> None:
    """10 % of spin from 10 to 20 s: 20 m/s reads as 22, and the wheel runs 20 m further."""
    on = creeping(world(end_s=30.0), lambda t: 0.1 if 10.0 < t < 20.0 else 0.0)
    said = readings(on, **exact())
    inside = [m.fields["speed_mps"] for m in said if 10.2 < m.measured_s < 19.8]
    outside = [m.fields["speed_mps"] for m in said if not 9.8 < m.measured_s < 20.2]
    assert inside == pytest.approx([22.0] * len(inside), abs=2e-3)
    assert outside == pytest.approx([20.0] * len(outside), abs=2e-3)
    run = sum(m.fields["speed_mps"] * m.fields["interval_s"] for m in said)
    assert run - 20.0 * (said[-1].measured_s - said[0].measured_s + 0.1) == pytest.approx(20.0, abs=0.5)


def test_a_locked_wheel_is_silent_at_full_speed() -> None:
    on = creeping(world(end_s=10.0), lambda t: -1.0 if t > 5.0 else 0.0)
    locked = [m for m in readings(on, **exact()) if m.measured_s > 5.2]
    assert locked
    assert all(m.fields["speed_max_mps"] < 0.3 for m in locked)


def test_a_device_switched_on_later_has_the_same_edges() -> None:
    on = world(jerk_psd=1e-4, end_s=20.0)
    unit = sensor("odometer", on.line, **TEN)
    whole = readings(on, **TEN)
    source = unit.open(on, 10.0)
    late = []
    while source.next_s() is not None:
        measured = source.read()
        if measured is not None:
            late.append(measured)
    assert late == [m for m in whole if m.measured_s >= late[0].measured_s]
    assert late[0].measured_s < 10.2


# observing ---------------------------------------------------------------------------------------------------------------


def belief(v: float = 20.0, k: float = 0.05, P_vv: float = 0.04, P_kk: float = 1e-4, P_kv: float = 1e-3) -> Belief:
    P = np.diag([1.0, P_vv, 0.01, P_kk])
    P[1, 3] = P[3, 1] = P_kv
    return Belief(np.array([500.0, v, 0.0, k]), P)


def test_hand_made_bytes_become_a_row() -> None:
    """v̂ = 21, κ̂ = 0.05: ẑ = 20; a reading of 20.2 explains v - 20 κ = 20 + 1.05 · 0.2 + c/1.05.

    c = P_κv - ẑ P_κκ = 0.001 - 20 · 1e-4 = -0.001. hPh = 0.04 - 2 · 20 · 0.001 + 400 · 1e-4 = 0.04.
    R = 1.05² · 0.01 + (1e-4 · 0.04 + 1e-6)/1.05².
    """

    def text(value: str) -> bytes:
        return bytes([0xA0 + len(value)]) + value.encode()

    def uint64(value: int) -> bytes:
        return b"\xcf" + value.to_bytes(8, "big")

    payload = b"".join(
        [
            b"\x89",  # a map of nine
            text("train") + text("metro-1"),
            text("unit") + text("odo-1"),
            text("instance") + text("a1b2c3d4"),
            text("sequence") + b"\x05",
            text("measured_at_ns") + uint64(T0),
            text("published_at_ns") + uint64(T0 + 1),
            text("speed_mps") + b"\xcb\x40\x34\x33\x33\x33\x33\x33\x33",  # 20.2
            text("speed_variance_m2ps2") + b"\xcb\x3f\x84\x7a\xe1\x47\xae\x14\x7b",  # 0.01
            text("interval_s") + b"\xcb\x3f\xb9\x99\x99\x99\x99\x99\x9a",  # 0.1
        ]
    )
    reading = decode(payload, SpeedReading)
    (seen,) = sensor("odometer", straight_line()).observe(reading, belief(v=21.0))
    assert seen.row == pytest.approx((0.0, 1.0, 0.0, -20.0))
    assert seen.value == pytest.approx(20.0 + 0.21 - 0.001 / 1.05)
    assert seen.variance == pytest.approx(1.05**2 * 0.01 + 5e-6 / 1.05**2)


def test_going_backwards_is_a_negative_speed_on_the_wire_and_in_the_row() -> None:
    reading = decode(encode(SpeedReading(**head(), speed_mps=-8.0, speed_variance_m2ps2=0.01)), SpeedReading)
    (seen,) = sensor("odometer", straight_line()).observe(reading, belief(v=-8.4, P_kk=1e-12, P_kv=0.0))
    assert seen.row == pytest.approx((0.0, 1.0, 0.0, 8.0))
    assert seen.value == pytest.approx(-8.0)


def test_silence_bounds_both_directions() -> None:
    """|z| < 0.3 in 0.1 s at κ̂ = 0.05: |v| < 0.315, on average less than 0.315 - 1.5 · 0.1/4 = 0.2775; J is worth 0.4 mm/s."""
    reading = SpeedReading(**head(), speed_max_mps=0.3, interval_s=0.1)
    (seen,) = sensor("odometer", straight_line()).observe(reading, belief())
    assert seen.row == (0.0, 1.0, 0.0, 0.0)
    assert seen.value == 0.0
    assert seen.variance == pytest.approx(0.2775**2 / 3.0 + (0.01 / 24.0) ** 2)
    (counted,) = sensor("odometer", straight_line(), timer_s=None).observe(reading, belief())
    # a count of zero weighs as any other: (0.3 - 1.5 · 0.1/4)²/4, on the wheel; and it tells of the diameter
    zero = SpeedReading(**head(), speed_mps=0.0, speed_variance_m2ps2=0.2625**2 / 4.0 + (0.01 / 24.0) ** 2)
    (as_reading,) = sensor("odometer", straight_line()).observe(zero, belief())
    assert counted.row == as_reading.row
    assert (counted.value, counted.variance) == pytest.approx((as_reading.value, as_reading.variance))


def test_the_private_state_is_as_the_options_say() -> None:
    (scale,) = sensor("odometer", straight_line(), scale_std=0.06, scale_noise_psd=1e-9).private_states
    assert (scale.name, scale.prior_mean, scale.prior_std, scale.noise_psd) == ("scale", 0.0, 0.06, 1e-9)
    assert math.isinf(scale.time_constant_s)
