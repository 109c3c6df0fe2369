"""The Janus pair: pitch and vertical speed cancel; one beam alone says how little it is worth."""

from __future__ import annotations

import math
from typing import Any

import msgpack
import numpy as np
import pytest

from examples import T0, all_readings, sensor, straight_line, world
from milepost.recordings.measured import Measured
from milepost.sensors.base import World
from milepost.sensors.observed import Belief
from milepost.sensors.radar.beam import beam_speed
from milepost_schemas import SpeedReading, decode

QUIET = 1e-18
LEVEL = {"speed_variance_m2ps2": QUIET, "scale_std": 0.0}


def readings(on: World, **options: Any) -> list[Measured]:
    return all_readings(sensor("janus_radar", on.line, "janus", **options).open(on, 0.0))


def shown(said: list[Measured]) -> np.ndarray:
    return np.array([m.fields["speed_mps"] for m in said])


def test_by_hand_one_degree_leaves_0_015_percent_of_1_7() -> None:
    """Forward 1.017300 v, backward 0.982395 v: their mean is 0.999848 v = cos 1° v, 0.0152 % low."""
    d, angle = math.radians(1.0), math.radians(45.0)
    mean = 0.5 * (beam_speed(1.0, 0.0, d, angle, True) + beam_speed(1.0, 0.0, d, angle, False))
    assert mean - 1.0 == pytest.approx(-0.000152, abs=1e-6)
    # on the level vertical speed cancels wholly; at 1° 0.5 m/s of it leaves 0.5 sin 1° = 0.0087 m/s
    for pitch, left in ((0.0, 0.0), (d, 0.008726)):
        both = [beam_speed(20.0, 0.5, pitch, angle, f) - beam_speed(20.0, 0.0, pitch, angle, f) for f in (True, False)]
        assert 0.5 * sum(both) == pytest.approx(left, abs=1e-6)
    assert both[0] == pytest.approx(-0.49120, abs=1e-4)


def test_a_static_pitch_of_the_whole_device_cancels() -> None:
    said = readings(world(end_s=1.0), mounting_pitch_deg=1.0, **LEVEL)
    assert shown(said) == pytest.approx(20.0 * 0.999848, abs=1e-5)


def test_the_bodys_pitch_and_vertical_speed_cancel_up_to_the_second_order() -> None:
    """0.2°: 20 m/s · δ²/2 = 0.0001 m/s, 0.03 m/s · sin δ = 0.0001 m/s; a single beam would err by 0.076 m/s."""
    said = readings(world(end_s=100.0), body_pitch_std_deg=0.2, vertical_speed_std_mps=0.03, **LEVEL)
    assert np.std(shown(said)) < 3e-4
    assert abs(np.mean(shown(said)) - 20.0) < 3e-4
    assert {m.fields["speed_variance_m2ps2"] for m in said} == {0.5 * QUIET}


def test_two_beams_halve_the_variance_of_one() -> None:
    said = readings(world(end_s=500.0), speed_variance_m2ps2=0.04, scale_std=0.0)
    assert {m.fields["speed_variance_m2ps2"] for m in said} == {0.02}
    assert np.var(shown(said) - 20.0) == pytest.approx(0.02, rel=4.0 * math.sqrt(2.0 / len(said)))


def test_one_beam_alone_states_the_leaking_pitch() -> None:
    """20 m/s at 45° with 0.2°: 0.0698 m/s; at 20 Hz with τ = 0.2 s worth 1/coth(0.125) = 1/8.0416 of a reading."""
    options = {"body_pitch_std_deg": 0.2, "dropout_rate_hz": 0.2, "dropout_mean_s": 2.0, "mounting_pitch_deg": 1.0}
    said = readings(world(end_s=1000.0), **options, **LEVEL)
    pair = [m for m in said if m.fields["speed_variance_m2ps2"] < 1e-12]
    single = [m for m in said if m.fields["speed_variance_m2ps2"] > 1e-12]
    # each beam hears e^{-0.4} = 67 % of the time: both 45 %, one 44 %, none 11 %
    p = math.exp(-0.4)
    spread = 4.0 * math.sqrt(2.0 * 2.0 * 0.25 / 1000.0)
    assert len(pair) / 20_001 == pytest.approx(p * p, abs=spread)
    assert len(single) / 20_001 == pytest.approx(2.0 * p * (1.0 - p), abs=spread)
    stated = (20.0 * math.radians(0.2)) ** 2 / math.tanh(0.125)
    assert single[0].fields["speed_variance_m2ps2"] == pytest.approx(stated, rel=1e-6)
    # about 440 s of error with a memory of 0.2 s: more than 1000 independent squares; the mounting's 1.7 % is not in it
    error = shown(single) - 20.0
    assert np.var(error) == pytest.approx((20.0 * math.radians(0.2)) ** 2, rel=4.0 * math.sqrt(2.0 / 1000))
    assert abs(np.mean(error)) < 4.0 * 0.0698 / math.sqrt(1000)


def test_water_on_the_line_and_the_dead_zone_silence_both_beams() -> None:
    times = [m.measured_s for m in readings(world(end_s=20.0), dropout_spans_m=[[100.0, 200.0]], **LEVEL)]
    assert not [t for t in times if 5.0 <= t < 10.0]
    slow = world([(0.0, 1.0), (10.0, 0.0)], end_s=20.0)
    assert max(m.measured_s for m in readings(slow, dead_zone_mps=0.1995, **LEVEL)) == pytest.approx(8.0)


def test_pairs_differ_by_the_prior_of_their_residual_scale() -> None:
    on = world(end_s=0.01)
    scales = []
    for i in range(400):
        source = sensor("janus_radar", on.line, f"janus-{i}", speed_variance_m2ps2=QUIET).open(on, 0.0)
        scales.append(20.0 / source.read().fields["speed_mps"] - 1.0)
    assert np.std(scales) == pytest.approx(1.5e-4, rel=4.0 / math.sqrt(800))


def test_hand_made_bytes_become_the_observation() -> None:
    """20.5 m/s ± √0.02 at v̂ = 20.0, κ̂ = 0, P = diag(1, 0.01, 1, 1e-4): ẑ = 20, μ = 1.

    h P h' = 0.01 + 400e-4 = 0.05, c = -0.002: value 20.5 - 0.002 = 20.498, R = 0.02 + 1e-4·0.05 + 4e-6 = 0.020009.
    """
    payload = (
        b"\x88\xa5train\xa1t\xa4unit\xa5janus\xa8instance\xa1i\xa8sequence\x03"
        b"\xaemeasured_at_ns\xcf\x17\x97\x9c\xfe\x36\x2a\x00\x00"
        b"\xafpublished_at_ns\xcf\x17\x97\x9c\xfe\x36\x2a\x00\x01"
        b"\xa9speed_mps\xcb\x40\x34\x80\x00\x00\x00\x00\x00"
        b"\xb4speed_variance_m2ps2\xcb\x3f\x94\x7a\xe1\x47\xae\x14\x7b"
    )
    assert msgpack.unpackb(payload)["measured_at_ns"] == T0
    reading = decode(payload, SpeedReading)
    pair = sensor("janus_radar", straight_line(), scale_std=0.01)
    at = Belief(np.array([0.0, 20.0, 0.0, 0.0]), np.diag([1.0, 0.01, 1.0, 1e-4]))
    ((row, value, variance),) = pair.observe(reading, at)
    assert row == (0.0, 1.0, 0.0, -20.0)
    assert value == pytest.approx(20.498)
    assert variance == pytest.approx(0.020009)
    assert pair.needs_belief
    assert pair.period_s == 0.05
    (state,) = pair.private_states
    assert (state.name, state.prior_std) == ("scale", 0.01)
