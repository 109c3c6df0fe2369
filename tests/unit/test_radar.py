"""Doppler radars err as their options say, and a filter takes each reading for what it is worth."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np
import pytest

from examples import T0, all_readings, head, sensor, straight_line, world
from milepost.estimation.kalman import predict, update
from milepost.estimation.layout import Layout, PrivateState
from milepost.estimation.motion import full_process_noise, full_transition
from milepost.recordings.measured import Measured
from milepost.sensors.base import World
from milepost.sensors.observed import Belief
from milepost.sensors.radar.beam import beam_speed
from milepost.sensors.radar.dropouts import Dropouts
from milepost.sensors.scale import scaled_speed
from milepost_schemas import SpeedReading, decode

QUIET = 1e-18


def readings(kind: str, on: World, unit: str = "unit", from_s: float = 0.0, **options: Any) -> list[Measured]:
    return all_readings(sensor(kind, on.line, unit, **options).open(on, from_s))


def shown(said: list[Measured]) -> np.ndarray:
    return np.array([m.fields["speed_mps"] for m in said])


def belief(mean: list[float], covariance: list[list[float]]) -> Belief:
    return Belief(np.array(mean), np.array(covariance))


# the beam --------------------------------------------------------------------------------------------------------------


def test_one_degree_of_pitch_at_45_degrees_is_1_7_percent() -> None:
    """cos 1° + sin 1° = 0.999848 + 0.017452 = 1.017300 forward, 0.982395 backward."""
    d = math.radians(1.0)
    assert beam_speed(1.0, 0.0, d, math.radians(45.0), True) == pytest.approx(1.017300, abs=1e-6)
    assert beam_speed(1.0, 0.0, d, math.radians(45.0), False) == pytest.approx(0.982395, abs=1e-6)


def test_a_beam_is_the_projection_of_the_velocity_on_its_line_of_sight() -> None:
    """Nose up by 2°, 30 m/s along, 0.5 m/s up, a beam 40° below the body's axis: the vectors written out."""
    pitch, angle = math.radians(2.0), math.radians(40.0)
    for forward, sign in ((True, 1.0), (False, -1.0)):
        direction = np.array([sign * math.cos(angle), -math.sin(angle)])
        turn = np.array([[math.cos(pitch), -math.sin(pitch)], [math.sin(pitch), math.cos(pitch)]])
        doppler = float((turn @ direction) @ np.array([30.0, 0.5]))
        expected = sign * doppler / math.cos(angle)
        assert beam_speed(30.0, 0.5, pitch, angle, forward) == pytest.approx(expected, rel=1e-12)


def test_a_static_mounting_pitch_looks_like_a_scale() -> None:
    said = readings("doppler_radar", world(end_s=1.0), speed_variance_m2ps2=QUIET, mounting_pitch_deg=1.0)
    assert shown(said) == pytest.approx(20.0 * 1.017300, abs=1e-4)


def test_the_stated_variance_includes_the_bodys_coloured_motion() -> None:
    """20 m/s, 45°: 0.2° is 0.0698 m/s. Pitch with τ = 0.5 s at 20 Hz: coth(0.05) = 20.017 readings are worth one."""
    options = {"body_pitch_std_deg": 0.2, "body_time_constant_s": 0.5, "rate_hz": 20.0, "vertical_speed_std_mps": 0.03}
    said = readings("doppler_radar", world(end_s=1000.0), speed_variance_m2ps2=QUIET, **options)
    error = shown(said) - 20.0
    variance = (20.0 * math.radians(0.2)) ** 2 + 0.03**2
    # 1000 s of a process with τ = 0.5 s hold about 1000 independent squares
    assert error.var() == pytest.approx(variance, rel=4.0 * math.sqrt(2.0 / 1000))
    assert said[0].fields["speed_variance_m2ps2"] == pytest.approx(variance / math.tanh(0.05), rel=1e-9)
    # what is stated is the error of a mean: of 20 s, 400 readings
    means = error[:20_000].reshape(50, 400).mean(axis=1)
    assert means.var() == pytest.approx(variance / math.tanh(0.05) / 400, rel=4.0 * math.sqrt(2.0 / 50))


# its defaults ---------------------------------------------------------------------------------------------------------


def test_the_radars_error_is_white_with_the_variance_that_it_states() -> None:
    on = world(end_s=200.0, jerk_psd=1e-6)
    said = readings("doppler_radar", on)
    n = len(said)
    assert n == 20_001
    assert {m.fields["speed_variance_m2ps2"] for m in said} == {0.04}
    error = np.array([m.fields["speed_mps"] - on.motion.at(m.measured_s)[1] for m in said])
    assert abs(error.mean()) < 4.0 * 0.2 / math.sqrt(n)
    assert error.var() == pytest.approx(0.04, rel=4.0 * math.sqrt(2.0 / n))
    # normal: the fourth moment is three times the squared variance, with a standard deviation of √96 / √n
    assert np.mean(error**4) / error.var() ** 2 == pytest.approx(3.0, abs=4.0 * math.sqrt(96.0 / n))
    for lag in (1, 2, 5, 512):
        assert abs(np.mean(error[lag:] * error[:-lag])) / 0.04 < 4.0 / math.sqrt(n)


@pytest.mark.parametrize(("rate_hz", "variance"), [(50.0, 0.25), (200.0, 0.01)])
def test_the_radar_keeps_its_rate_and_variance_as_configured(rate_hz: float, variance: float) -> None:
    on = world(end_s=40.0)
    said = readings("doppler_radar", on, rate_hz=rate_hz, speed_variance_m2ps2=variance)
    assert [m.measured_s for m in said] == pytest.approx(np.arange(len(said)) / rate_hz)
    assert len(said) == 40.0 * rate_hz + 1
    error = np.array([m.fields["speed_mps"] - 20.0 for m in said])
    assert error.var() == pytest.approx(variance, rel=5.0 * math.sqrt(2.0 / len(said)))


def test_the_radar_observes_the_speed() -> None:
    radar = sensor("doppler_radar", straight_line())
    reading = SpeedReading(**head(), speed_mps=12.5, speed_variance_m2ps2=0.04)
    assert [tuple(o) for o in radar.observe(reading, None)] == [((0.0, 1.0, 0.0), 12.5, 0.04)]
    assert radar.period_s == 0.01


# noise, dead zone, drop-outs ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [5.0, 40.0])
def test_noise_has_a_constant_part_and_one_that_grows_with_speed(speed: float) -> None:
    on = world([(0.0, speed)], end_s=50.0)
    said = readings("doppler_radar", on, speed_variance_m2ps2=0.01, noise_ratio=0.01)
    variance = 0.01 + (0.01 * speed) ** 2
    assert [m.fields["speed_variance_m2ps2"] for m in said] == pytest.approx([variance] * len(said))
    assert (shown(said) - speed).var() == pytest.approx(variance, rel=4.0 * math.sqrt(2.0 / len(said)))


def test_in_its_dead_zone_a_radar_sends_no_reading() -> None:
    """From 1 m/s to 0 in 10 s: below 0.1995 m/s after t = 8.005 s."""
    on = world([(0.0, 1.0), (10.0, 0.0)], end_s=20.0)
    said = readings("doppler_radar", on, dead_zone_mps=0.1995)
    assert [m.measured_s for m in said] == pytest.approx((np.arange(801) / 100.0).tolist())
    assert all("speed_max_mps" not in m.fields for m in said)


@pytest.mark.slow
def test_drop_outs_take_the_configured_share_of_time() -> None:
    """Beginnings at 0.05 Hz, 2 s long: 1 - exp(-0.05 · 2) = 9.5 % of all time, in silences of (e^{λD} - 1)/λ = 2.1 s."""
    times, lost, silences = np.arange(0.0, 20_000.0, 0.1), 0, []
    for seed in range(3):
        dumb = Dropouts(seed, "radar", 0.05, 2.0)
        said = [t for t in times.tolist() if not dumb.at(t)]
        lost += len(times) - len(said)
        silences += [b - a - 0.1 for a, b in itertools.pairwise(said) if b - a > 0.15]
    # the share's autocovariance falls from p (1 - p) within 2 s: a mean over T has the variance 2 · 2 s · p (1 - p)/T, or less
    p = -math.expm1(-0.1)
    assert lost / (3 * len(times)) == pytest.approx(p, abs=4.0 * math.sqrt(2.0 * 2.0 * p * (1.0 - p) / 60_000.0))
    assert np.mean(silences) == pytest.approx(math.expm1(0.1) / 0.05, abs=0.1 + 4.0 * 2.2 / math.sqrt(len(silences)))


def test_a_radar_that_drops_out_is_silent_then() -> None:
    options = {"dropout_rate_hz": 0.5, "dropout_mean_s": 1.0}
    dumb = Dropouts(1, "unit", 0.5, 1.0)
    expected = [t for t in (np.arange(2001) / 100.0).tolist() if not dumb.at(t)]
    assert 0 < len(expected) < 2001
    assert [m.measured_s for m in readings("doppler_radar", world(end_s=20.0), **options)] == pytest.approx(expected)


def test_water_on_the_line_silences_the_radar_there() -> None:
    said = readings("doppler_radar", world(end_s=20.0), dropout_spans_m=[[100.0, 200.0]])
    times = np.array([m.measured_s for m in said])
    assert not np.any((times >= 5.0) & (times < 10.0))
    assert len(times) == 2001 - 500


def test_a_restarted_radar_has_the_drop_outs_and_the_body_it_had() -> None:
    options = {"dropout_rate_hz": 0.1, "body_pitch_std_deg": 0.2, "scale_std": 0.01, "scale_time_constant_s": 100.0}
    on = world(end_s=60.0)
    for kind in ("doppler_radar", "janus_radar"):
        whole, late = (readings(kind, on, from_s=t, **options) for t in (0.0, 33.0))
        assert late == [m for m in whole if m.measured_s >= 33.0]


# the sign ------------------------------------------------------------------------------------------------------------------


def test_a_radar_without_a_sign_shows_the_speed_of_a_train_that_rolls_back() -> None:
    said = readings("doppler_radar", world([(0.0, -3.0)], end_s=1.0, start_m=100.0), speed_variance_m2ps2=QUIET, signed=False)
    assert shown(said) == pytest.approx(3.0)


def test_the_belief_gives_the_sign_or_the_speed_is_zero_plus_minus_z() -> None:
    radar = sensor("doppler_radar", straight_line(), signed=False)
    reading = SpeedReading(**head(), speed_mps=2.0, speed_variance_m2ps2=0.04)
    back = belief([0.0, -1.9, 0.0], [[1.0, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 1.0]])
    unsure = belief([0.0, -0.1, 0.0], [[1.0, 0.0, 0.0], [0.0, 4.0, 0.0], [0.0, 0.0, 1.0]])
    assert [tuple(o) for o in radar.observe(reading, back)] == [((0.0, 1.0, 0.0), -2.0, 0.04)]
    for vague in (unsure, None):
        assert [tuple(o) for o in radar.observe(reading, vague)] == [((0.0, 1.0, 0.0), 0.0, pytest.approx(4.04))]
    assert radar.needs_belief


# the scale -----------------------------------------------------------------------------------------------------------------


def test_units_differ_by_the_prior_of_their_scale() -> None:
    """400 units of 1 %: the spread of 400 draws is known to 1/√800."""
    on = world(end_s=0.05)
    options = {"speed_variance_m2ps2": QUIET, "scale_std": 0.01}
    scales = [20.0 / readings("doppler_radar", on, f"radar-{i}", **options)[0].fields["speed_mps"] - 1.0 for i in range(400)]
    assert np.std(scales) == pytest.approx(0.01, rel=4.0 / math.sqrt(800))
    assert abs(np.mean(scales)) < 4.0 * 0.01 / 20.0


def test_a_given_scale_is_the_scale() -> None:
    said = readings("doppler_radar", world(end_s=0.05), speed_variance_m2ps2=QUIET, simulated={"scale": 0.002})
    assert shown(said) == pytest.approx(20.0 / 1.002)


@pytest.mark.slow
def test_a_simulated_scale_moves_as_in_the_filters_model() -> None:
    """A walk of 1e-6/s over 10 s: 0.00316; Markov of τ = 20 s: correlation e^-0.5 after 10 s. 100 seeds each."""
    walk, markov = [], []
    quiet = {"speed_variance_m2ps2": QUIET, "rate_hz": 0.1}
    for seed in range(100):
        on = world(end_s=10.0, seed=seed)
        a = 20.0 / shown(readings("doppler_radar", on, scale_std=0.01, scale_noise_psd=1e-6, **quiet)) - 1.0
        b = 20.0 / shown(readings("doppler_radar", on, scale_std=0.01, scale_time_constant_s=20.0, **quiet)) - 1.0
        walk.append(a[1] - a[0])
        markov.append((b[0], b[1]))
    assert np.std(walk) == pytest.approx(math.sqrt(1e-6 * 10.0), rel=4.0 / math.sqrt(200))
    first, later = np.array(markov).T
    assert np.std(later) == pytest.approx(0.01, rel=4.0 / math.sqrt(200))
    assert np.corrcoef(first, later)[0, 1] == pytest.approx(math.exp(-0.5), abs=4.0 * (1.0 - math.exp(-1.0)) / math.sqrt(100))
    (state,) = sensor("doppler_radar", straight_line(), scale_std=0.01, scale_time_constant_s=20.0).private_states
    assert (state.time_constant_s, state.noise_psd) == (20.0, pytest.approx(1e-5))


def test_a_markov_scale_with_a_random_walk_is_refused() -> None:
    with pytest.raises(ValueError, match="must not stand beside"):
        sensor("doppler_radar", straight_line(), scale_std=0.01, scale_time_constant_s=20.0, scale_noise_psd=1e-9)


def test_without_a_scale_option_there_is_no_private_state() -> None:
    radar = sensor("doppler_radar", straight_line())
    assert radar.private_states == ()
    assert not radar.needs_belief


def test_a_scaled_reading_by_hand() -> None:
    """v̂ = 20.2, κ̂ = 0.01: μ = 1.01, ẑ = 20. P_vv = 0.04, P_kv = 1e-4, P_kk = 1e-4; z = 20.5, R = 0.04.

    h P h' = 0.04 - 2·20·1e-4 + 400·1e-4 = 0.076; c = 1e-4 - 20·1e-4 = -0.0019.
    Value 20 + 1.01·0.5 - 0.0019/1.01 = 20.5031188; R = 1.0201·0.04 + (1e-4·0.076 + 0.0019²)/1.0201 = 0.0408150.
    """
    at = belief([0.0, 20.2, 0.0, 0.01], [[1, 0, 0, 0], [0, 0.04, 0, 1e-4], [0, 0, 1, 0], [0, 1e-4, 0, 1e-4]])
    row, value, variance = scaled_speed(20.5, 0.04, at, PrivateState("scale", 0.0, 0.01))
    assert row == (0.0, 1.0, 0.0, pytest.approx(-20.0))
    assert value == pytest.approx(20.5031188, abs=1e-7)
    assert variance == pytest.approx(0.0408150, abs=1e-7)


def test_hand_made_bytes_become_the_observation() -> None:
    """A payload as another language would pack it, written out: fixmap of 8, two floats of 64 bits (12.5 and 0.25).

    Without a belief: row [0, 1, 0, -12.5], value 12.5, R = (1 + 0.01²) 0.25 = 0.250025.
    """
    payload = (
        b"\x88\xa5train\xa1t\xa4unit\xa5radar\xa8instance\xa1i\xa8sequence\x03"
        b"\xaemeasured_at_ns\xcf\x17\x97\x9c\xfe\x36\x2a\x00\x00"
        b"\xafpublished_at_ns\xcf\x17\x97\x9c\xfe\x36\x2a\x00\x01"
        b"\xa9speed_mps\xcb\x40\x29\x00\x00\x00\x00\x00\x00"
        b"\xb4speed_variance_m2ps2\xcb\x3f\xd0\x00\x00\x00\x00\x00\x00"
    )
    assert msgpack.unpackb(payload)["measured_at_ns"] == T0
    reading = decode(payload, SpeedReading)
    radar = sensor("doppler_radar", straight_line(), scale_std=0.01)
    ((row, value, variance),) = radar.observe(reading, None)
    assert (row, value) == ((0.0, 1.0, 0.0, -12.5), 12.5)
    assert variance == pytest.approx(0.250025)


def test_a_radar_refuses_a_bound() -> None:
    assert sensor("doppler_radar", straight_line()).observe(SpeedReading(**head(), speed_max_mps=0.5), None) == ()


def nees_with(observe: Callable[..., Any], scale_std: float, seed: int) -> list[float]:
    """NEES of [s, v, a, κ] just before and 2 s after position fixes begin: 50 Hz at 60 m/s, R = 0.04."""
    rng, state, dt, q = np.random.default_rng(seed), PrivateState("scale", 0.0, scale_std), 0.02, 1e-6
    layout = Layout((("radar", (state,)),))
    F, Q = full_transition(dt, layout), full_process_noise(dt, q, layout)
    std = np.array([0.5, 3.0, 0.01])
    m, P = layout.prior(np.array([0.0, 60.0, 0.0]), std)
    x = m + np.sqrt(np.diag(P)) * rng.normal(size=4)
    drive = np.linalg.cholesky(Q[:3, :3] + 1e-30 * np.eye(3))
    out = []
    for k in range(1, 501):
        x = F @ x
        x[:3] += drive @ rng.normal(size=3)
        m, P = predict(m, P, F, Q)
        z = x[1] / (1.0 + x[3]) + 0.2 * rng.normal()
        row, value, R = observe(z, 0.04, Belief(m, P), state)
        m, P = update(m, P, np.array(row), value, R)
        if k > 400 and k % 50 == 0:
            m, P = update(m, P, np.array([1.0, 0.0, 0.0, 0.0]), x[0] + 0.02 * rng.normal(), 4e-4)
        if k in (400, 500):
            scale = np.sqrt(np.diag(P))
            e = (m - x) / scale
            out.append(float(e @ np.linalg.solve(P / np.outer(scale, scale), e)))
    return out


@pytest.mark.slow
def test_early_readings_are_consistent_with_a_one_percent_scale_prior() -> None:
    """100 runs, 4 states: the mean's 95 % interval is 4 ± 1.96 √(8/100)."""
    before, after = np.mean([nees_with(scaled_speed, 0.01, seed) for seed in range(100)], axis=0)
    assert abs(before - 4.0) < 1.96 * math.sqrt(0.08)
    assert abs(after - 4.0) < 1.96 * math.sqrt(0.08)
