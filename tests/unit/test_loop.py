"""The induction loop errs as its options say; a missed crossing costs neither speed nor position where the speed is known."""

from __future__ import annotations

import itertools
import math
from typing import Any

import msgpack
import numpy as np
import pytest

from examples import T0, all_readings, head, sensor, straight_line, world
from milepost.estimation.kalman import predict, update
from milepost.estimation.layout import Layout
from milepost.estimation.motion import full_process_noise, full_transition
from milepost.recordings.measured import Measured, Source
from milepost.sensors.base import World
from milepost.sensors.loop.count import Faults, pitches
from milepost.sensors.loop.crossings import Crossings, Unseen
from milepost.sensors.observed import Belief
from milepost_schemas import SpeedReading, decode


def opened(on: World, from_s: float = 0.0, **options: Any) -> Source:
    return sensor("induction_loop", on.line, **options).open(on, from_s)


def speeds(measured: list[Measured]) -> list[Measured]:
    return [m for m in measured if m.fields.get("speed_mps") is not None]


def bounds(measured: list[Measured]) -> list[Measured]:
    return [m for m in measured if m.fields.get("speed_max_mps") is not None]


PITCH, PITCH_STD = 0.1, 0.00224


@pytest.mark.parametrize("speed", [3.0, 20.0, 47.0])
def test_the_loop_states_the_variance_of_its_error(speed: float) -> None:
    on = world([(0.0, speed)], end_s=60.0)
    # before the first interval of one pitch the device knows no speed: the train may have turned round in it
    said = speeds(all_readings(opened(on)))[1:]
    assert len(said) > 1000
    squares = []
    for m in said:
        dt = m.fields["interval_s"]
        pitches = m.fields["speed_mps"] * dt / PITCH
        assert pitches == pytest.approx(round(pitches), abs=1e-9)
        assert m.fields["speed_variance_m2ps2"] == pytest.approx(round(pitches) * PITCH_STD**2 / dt**2)
        error = m.fields["speed_mps"] - speed
        squares.append(error**2 / m.fields["speed_variance_m2ps2"])
    assert np.mean(squares) == pytest.approx(1.0, abs=5.0 * math.sqrt(2.0 / len(squares)))


def test_the_loops_variance_at_20_metres_a_second_is_that_of_the_source() -> None:
    said = speeds(all_readings(opened(world(end_s=20.0))))
    variance = np.mean([m.fields["speed_variance_m2ps2"] for m in said])
    assert variance == pytest.approx(0.1, rel=0.02)


@pytest.mark.slow
def test_the_loops_readings_lie_end_to_end_and_add_up_to_32_centimetres_rms_after_2_kilometres() -> None:
    """√(2000 m / 0.1 m) · 2.24 mm = 0.317 m: a missed or doubled interval would add at least a pitch each."""
    errors = []
    for seed in range(30):
        on = world([(0.0, 50.0)], end_s=40.05, seed=seed)
        said = speeds(all_readings(opened(on)))
        middle, speed = np.array([(m.measured_s, m.fields["speed_mps"]) for m in said]).T
        half = 0.5 * np.array([m.fields["interval_s"] for m in said])
        begin, end = middle - half, middle + half
        assert np.abs(begin[1:] - end[:-1]).max() < 1e-9
        travelled = on.motion.at(float(end[-1]))[0] - on.motion.at(float(begin[0]))[0]
        errors.append(float(speed @ (2.0 * half)) - travelled)
    expected = PITCH_STD * math.sqrt(2000.0 / PITCH)
    assert expected == pytest.approx(0.317, abs=0.001)
    assert math.sqrt(np.mean(np.square(errors))) == pytest.approx(expected, rel=4.0 / math.sqrt(2 * len(errors)))
    assert abs(np.mean(errors)) < 4.0 * expected / math.sqrt(len(errors))


def test_the_loop_stamps_a_reading_where_the_speed_is_the_mean_speed() -> None:
    """At 2 m/s² a stamp at the last pulse would be off by a Δt/2, about 0.01 m/s."""
    on = world([(0.0, 5.0), (20.0, 45.0)], end_s=19.0)
    said = speeds(all_readings(opened(on, pitch_std_m=1e-9)))
    assert len(said) > 1000
    for m in said:
        assert m.fields["speed_mps"] == pytest.approx(on.motion.at(m.measured_s)[1], abs=1e-5)


def test_the_loops_silence_is_a_true_bound_in_each_window_for_ever() -> None:
    """0.1 m: windows of 0.854 s, read out each 10 ms; √(0.1 · 1.5) = 0.387 m/s each."""
    on = world([(0.0, 4.0), (8.0, 0.0)], end_s=30.0)
    said = all_readings(opened(on, pitch_std_m=1e-9))
    assert all(m.fields["speed_mps"] > 0.0 for m in speeds(said))
    silence = bounds(said)
    assert len(silence) >= 24
    for m in silence:
        assert set(m.fields) == {"speed_max_mps", "interval_s"}
        assert m.fields["speed_max_mps"] == pytest.approx(math.sqrt(0.15))
        assert m.fields["interval_s"] == pytest.approx(0.859, abs=0.006)
    gaps = [b.measured_s - a.measured_s for a, b in itertools.pairwise(silence)]
    assert gaps == pytest.approx([0.86] * len(gaps), abs=0.006)


def test_a_loop_that_starts_at_standstill_says_bounds_alone() -> None:
    said = all_readings(opened(world([(0.0, 0.0)], end_s=20.0)))
    assert speeds(said) == []
    assert len(bounds(said)) == 22


def test_the_loop_takes_a_bound_as_standstill_give_or_take() -> None:
    """0.5 m/s over 0.2 s are 0.085 m of way, 0.425 m/s on average: 0.425²/3, and 1/600 m/s for the jerk."""
    loop = sensor("induction_loop", straight_line())
    bound = SpeedReading(**head(), speed_max_mps=0.5, interval_s=0.2)
    ((row, value, variance),) = loop.observe(bound, None)
    assert (row, value) == ((0.0, 1.0, 0.0), 0.0)
    assert variance == pytest.approx(0.425**2 / 3.0 + (0.04 / 24.0) ** 2)
    value = SpeedReading(**head(), speed_mps=20.0, speed_variance_m2ps2=0.1)
    assert [tuple(o) for o in loop.observe(value, None)] == [((0.0, 1.0, 0.0), 20.0, 0.1)]
    assert loop.period_s is None


def test_crossings_are_a_fixed_property_of_the_track() -> None:
    forward, backward = (Crossings(1, "loop", PITCH, PITCH_STD) for _ in range(2))
    wanted = [0, 1, 511, 512, 513, 2000, 5119, 5120]
    places = {k: forward.position(k) for k in wanted}
    assert {k: backward.position(k) for k in reversed(wanted)} == places
    steps = np.diff([forward.position(k) for k in range(6000)])
    assert steps.mean() == pytest.approx(PITCH, abs=4.0 * PITCH_STD / math.sqrt(6000))
    assert steps.std() == pytest.approx(PITCH_STD, rel=4.0 / math.sqrt(2 * 6000))
    for position in (0.0, 0.05, 51.3, 200.0, 511.99):
        k = forward.last_before(position)
        assert forward.position(k) <= position < forward.position(k + 1)


# missed crossings ------------------------------------------------------------------------------------------------------------


def counted(said: list[Measured]) -> tuple[np.ndarray, np.ndarray]:
    """Pitches that the readings say, and pitches that the train passed meanwhile at 20 m/s."""
    dt = np.array([m.fields["interval_s"] for m in said])
    return np.array([m.fields["speed_mps"] for m in said]) * dt / PITCH, 20.0 * dt / PITCH


def test_crossings_are_missed_with_their_probability_each_by_itself() -> None:
    """20 000 crossings, 1 %: 200 ± √198; two in a row 1 % of those."""
    unseen = Unseen(3, "loop.0", PITCH, 0.01, None, 1.0)
    missed = [k for k in range(20_000) if k in unseen]
    assert len(missed) == pytest.approx(200, abs=4.0 * math.sqrt(198.0))
    pairs = sum(b - a == 1 for a, b in itertools.pairwise(missed))
    assert pairs <= 2 + 4.0 * math.sqrt(2.0)


def test_a_missed_crossing_makes_one_reading_say_one_pitch_too_few() -> None:
    said = speeds(all_readings(opened(world(end_s=100.0), pitch_std_m=1e-9, missed_probability=0.01)))
    saw, passed = counted(said)
    short = np.round(passed - saw)
    assert np.abs(passed - saw - short).max() < 1e-6
    assert set(short) <= {0.0, 1.0, 2.0, 3.0}
    assert short.sum() == pytest.approx(200, abs=4.0 * math.sqrt(198.0))


@pytest.mark.parametrize("seen", [100, 250, 299, 301, 3000, 10**9])
def test_however_many_pulses_there_were_some_were_missed(seen: int) -> None:
    """Negative binomial, q = 0.1: n = m/0.9, variance m 0.1/0.81, whether summed or taken as normal."""
    n = pitches(seen, None, 0.0, 0.0, Faults(0.1, 0, 0.0))
    assert n.mean == pytest.approx(seen / 0.9, rel=1e-6)
    assert n.variance == pytest.approx(seen * 0.1 / 0.81, rel=1e-4)


@pytest.mark.parametrize("seen", [299, 301])
def test_a_belief_counts_the_same_on_both_sides_of_many(seen: int) -> None:
    """Prior variance 37, the belief's 4: n is nearly what was expected, with a little less than 4."""
    n = pitches(seen, seen / 0.9 + 6.0, 4.0, 0.0, Faults(0.1, 0, 0.0))
    assert n.mean == pytest.approx(seen / 0.9 + 6.0 * 37.0 / 41.0, abs=0.1)
    assert n.variance == pytest.approx(37.0 * 4.0 / 41.0, abs=0.15)
    wrong = pitches(seen, 1000.0, 4.0, 0.0, Faults(0.1, 0, 0.0))
    assert wrong.mean == pytest.approx(seen / 0.9, abs=0.5)


def test_a_belief_that_knows_the_speed_decides_how_many_pitches_there_were() -> None:
    """Two pulses seen where 3.02 ± 0.1 pitches were expected: three. With σ = 0.1 and r = 0, against two:

    C(2,1) 0.001 (φ(0.2)/0.1 + ε) : φ(10.2)/0.1 + ε = 0.0078 : 1e-5, and n = 4 has 3e-6 · 1e-5.
    """
    n = pitches(2, 3.02, 0.01, 0.0, Faults(0.001, 0, 0.0))
    assert n.mean == pytest.approx(3.0, abs=2e-3)
    assert n.variance == pytest.approx(1e-5 / 0.0078, rel=0.1)


def test_one_that_does_not_leaves_a_variance() -> None:
    """Negative binomial: m q/(1 - q) misses, variance m q/(1 - q)²."""
    n = pitches(2, None, 0.0, 0.0, Faults(0.1, 0, 0.0))
    assert n.mean - 2.0 == pytest.approx(0.2 / 0.9, rel=1e-3)
    assert n.variance == pytest.approx(0.2 / 0.81, rel=1e-3)


def test_a_wrong_belief_does_not_make_the_loop_confirm_it() -> None:
    """Twice the speed would need as many misses as pulses, in every reading: 10 of 20 with q = 0.1 % is out of the question."""
    assert pitches(10, 20.0, 1e-4, 0.0, Faults(0.001, 0, 0.0)).mean == pytest.approx(10.0, abs=0.05)


def test_a_reading_that_lacks_a_pitch_is_corrected() -> None:
    """Two pitches in 15 ms are 13.3 m/s; the belief says 20 ± 0.1 m/s, that is 3 pitches: 0.3 m/0.015 s = 20 m/s.

    R = 3 σ²/Δt² = 3 · 0.00224²/0.015² = 0.0669, and a little for what remains in doubt.
    """
    loop = sensor("induction_loop", straight_line(), missed_probability=1e-3)
    assert loop.needs_belief
    reading = SpeedReading(**head(), speed_mps=0.2 / 0.015, speed_variance_m2ps2=2 * PITCH_STD**2 / 0.015**2, interval_s=0.015)
    knows = Belief(np.array([0.0, 20.0, 0.0]), np.diag([1.0, 0.01, 1.0]))
    ((row, value, variance),) = loop.observe(reading, knows)
    assert row == (0.0, 1.0, 0.0)
    assert value == pytest.approx(20.0, abs=0.02)
    assert variance == pytest.approx(3.0 * PITCH_STD**2 / 0.015**2, rel=0.6)
    knows_not = Belief(np.array([0.0, 20.0, 0.0]), np.diag([1.0, 400.0, 1.0]))
    assert loop.observe(reading, knows_not)[0].variance > 0.0669 + 1e-3 * (0.1 / 0.015) ** 2


def test_silence_lasts_as_long_as_misses_and_a_joint_may_hide() -> None:
    """q = 0.1 %: two in a row are one in a million, so three pitches; with a joint of 1 m, 13; σ adds 5 · 2.24 mm."""

    def gap(**options: Any) -> float:
        return float(sensor("induction_loop", straight_line(), **options).options.longest_gap_m)

    assert gap() == pytest.approx(0.1112)
    assert gap(missed_probability=1e-3) == pytest.approx(0.3112)
    assert gap(missed_probability=1e-3, joint_every_m=100.0) == pytest.approx(1.3112)
    assert gap(missed_probability=1e-3, joint_every_m=100.0, antennas=2) == pytest.approx(0.3112)


def test_the_bound_over_a_joint_is_true() -> None:
    """At 0.4 m/s a joint of 1 m is 2.5 s of silence; a loop that reckoned with a pitch alone would say 0.387 m/s twice."""
    on = world([(0.0, 0.4)], end_s=400.0)
    said = bounds(all_readings(opened(on, **JOINTS)))
    assert len(said) >= 3
    assert all(m.fields["speed_max_mps"] > 0.4 for m in said)


def run(on: World, **options: Any) -> tuple[float, float]:
    """(position error, NEES of [s, v]) at the end of a run on the loop alone, from a known start."""
    loop, layout, q = sensor("induction_loop", on.line, **options), Layout(), 1e-6
    m, P, at = np.array([0.0, on.motion.at(0.0)[1], 0.0]), np.diag([1e-6, 1e-2, 1e-4]), 0.0
    for i, said in enumerate(all_readings(loop.open(on, 0.0))):
        dt, at = said.measured_s - at, said.measured_s
        if dt > 0.0:
            m, P = predict(m, P, full_transition(dt, layout), full_process_noise(dt, q, layout))
        reading = SpeedReading(**head(sequence=i), **said.fields)
        for row, value, R in loop.observe(reading, Belief(m, P)):
            m, P = update(m, P, np.array(row), value, R)
    e = m[:2] - np.array(on.motion.at(at)[:2])
    return float(e[0]), float(e @ np.linalg.solve(P[:2, :2], e))


@pytest.mark.slow
def test_missed_crossings_cost_no_position_and_the_result_is_as_good_as_it_says() -> None:
    """25 s at 20 m/s, 1 % of 5000 crossings missed: uncorrected 5 m are lost; corrected √5000 · 2.24 mm = 0.16 m remain."""
    runs = [run(world(end_s=25.0, seed=seed, jerk_psd=1e-6), missed_probability=0.01) for seed in range(12)]
    errors, nees = np.array(runs).T
    assert math.sqrt(np.mean(errors**2)) < 0.158 * (1.0 + 4.0 / math.sqrt(24))
    # chi-square of 2 · 12 degrees: mean 24, standard deviation √48
    assert nees.sum() < 24.0 + 4.0 * math.sqrt(48.0)


# joints and two antennas -----------------------------------------------------------------------------------------------------

JOINTS = {"joint_every_m": 50.0, "joint_length_m": 1.0}


def test_a_joint_has_no_crossings() -> None:
    """50 m to 51 m and so on: crossings 500 to 509 lack; the loop begins without a joint."""
    unseen = Unseen(3, "loop.0", PITCH, 0.0, 50.0, 1.0)
    assert [k for k in range(1200) if k in unseen] == [*range(500, 510), *range(1000, 1010)]


def test_one_antenna_is_silent_over_a_joint_and_the_next_reading_spans_it() -> None:
    said = speeds(all_readings(opened(world(end_s=30.0), pitch_std_m=1e-9, **JOINTS)))
    saw, passed = counted(said)
    assert sorted(np.round(passed - saw)) == [0.0] * (len(said) - 11) + [10.0] * 11


def test_a_belief_bridges_a_joint_with_one_antenna() -> None:
    errors = [run(world(end_s=25.0, seed=seed, jerk_psd=1e-6), **JOINTS) for seed in range(6)]
    assert max(abs(e) for e, _ in errors) < 4.0 * 0.158
    assert sum(nees for _, nees in errors) < 12.0 + 4.0 * math.sqrt(24.0)


@pytest.mark.parametrize("speed", [2.0, 20.0, 80.0])
def test_two_antennas_bridge_every_joint_and_no_reading_lacks_a_pitch(speed: float) -> None:
    """0.1 s without a reading is at most what three pulses take, and never as long as the joint."""
    said = speeds(all_readings(opened(world([(0.0, speed)], end_s=400.0 / speed), pitch_std_m=1e-9, antennas=2, **JOINTS)))
    assert len(said) > 100
    assert [m.fields["speed_mps"] for m in said] == pytest.approx([speed] * len(said), rel=1e-5)
    ends = np.array([m.measured_s + 0.5 * m.fields["interval_s"] for m in said])
    assert np.diff(ends).max() < 4.5 * PITCH / speed + 0.02


@pytest.mark.parametrize("speed", np.linspace(9.0, 60.0, 18).tolist())
@pytest.mark.parametrize(("pitch_m", "rate_hz"), [(0.1, 10.0), (0.2, 10.0), (0.2, 20.0)])
def test_a_joint_that_begins_in_one_window_and_ends_in_the_next_is_bridged_too(
    pitch_m: float, rate_hz: float, speed: float
) -> None:
    """GIVEN most of a joint's crossings lack in the window before, WHEN the rest lacks in this one, THEN no reading lacks any.

    There is no reading of a window in which both antennas were over the joint, one at most at each of 8 joints.
    """
    options = {"pitch_m": pitch_m, "rate_hz": rate_hz, "pitch_std_m": 1e-9, "antennas": 2, **JOINTS}
    said = speeds(all_readings(opened(world([(0.0, speed)], end_s=400.0 / speed), **options)))
    assert [m.fields["speed_mps"] for m in said] == pytest.approx([speed] * len(said), rel=1e-5)
    assert len(said) >= 400.0 / speed * rate_hz - 8 - 2


@pytest.mark.parametrize("from_s", [3.0, 7.777, 12.5])
def test_a_restarted_loop_misses_what_it_would_have_missed(from_s: float) -> None:
    """None of these times is within a second of a joint, from which an antenna that begins there would not know it comes."""
    on, options = world(end_s=20.0, jerk_psd=1e-6), {"missed_probability": 0.01, "joint_every_m": 110.0, "antennas": 2}
    whole, late = all_readings(opened(on, **options)), all_readings(opened(on, from_s, **options))
    assert late[0].measured_s < from_s + 0.05
    assert late == [m for m in whole if m.measured_s >= late[0].measured_s]


def test_antennas_that_would_be_over_a_joint_at_once_are_refused() -> None:
    with pytest.raises(ValueError, match="never over a joint at once"):
        sensor("induction_loop", straight_line(), antennas=2, antenna_spacing_m=0.5, **JOINTS)
    with pytest.raises(ValueError, match="half of joint_every_m"):
        sensor("induction_loop", straight_line(), joint_every_m=1.5)


# a loop that is not as believed ------------------------------------------------------------------------------------------


def test_a_loop_laid_longer_than_believed_reads_low() -> None:
    """0.101 m for 0.1 m: 20 m/s read as 19.80."""
    said = speeds(all_readings(opened(world(end_s=20.0), simulated={"pitch_m": 0.101, "pitch_std_m": 1e-9})))
    assert np.mean([m.fields["speed_mps"] for m in said]) == pytest.approx(20.0 / 1.01, rel=1e-4)
    assert np.mean([m.fields["speed_variance_m2ps2"] for m in said]) == pytest.approx(0.1, rel=0.02)


def test_a_loop_may_miss_crossings_that_its_filter_does_not_reckon_with() -> None:
    loop = sensor("induction_loop", straight_line(), pitch_std_m=1e-9, simulated={"missed_probability": 0.01})
    assert loop.options.faults is None
    said = speeds(all_readings(loop.open(world(end_s=100.0), 0.0)))
    saw, passed = counted(said)
    assert np.round(passed - saw).sum() == pytest.approx(200, abs=4.0 * math.sqrt(198.0))


def test_a_simulated_loop_is_as_believed_where_nothing_is_given() -> None:
    on, options = world(end_s=20.0), {"missed_probability": 0.01, "joint_every_m": 60.0}
    believed_laid = all_readings(opened(on, **options, simulated={"missed_probability": 0.01}))
    assert believed_laid == all_readings(opened(on, **options))
    assert all_readings(opened(on, simulated={"joint_every_m": 60.0})) != all_readings(opened(on))


@pytest.mark.parametrize(
    ("simulated", "says"),
    [
        ({"pitch": 0.1}, "simulated.pitch"),
        ({"pitch_m": "0.1"}, "simulated.pitch_m"),
        ({"joint_every_m": 1.5}, "simulated: joint_length_m must be less than half"),
    ],
)
def test_a_simulated_loop_that_cannot_be_is_refused(simulated: dict[str, Any], says: str) -> None:
    with pytest.raises(ValueError, match=says):
        sensor("induction_loop", straight_line(), simulated=simulated)


def test_hand_made_bytes_become_the_observation() -> None:
    """20 m/s and 0.125 (m/s)² over 10 ms, each a float of 64 bits: taken as said, for a loop that misses nothing."""
    payload = (
        b"\x89\xa5train\xa1t\xa4unit\xa4loop\xa8instance\xa1i\xa8sequence\x03"
        b"\xaemeasured_at_ns\xcf\x17\x97\x9c\xfe\x36\x2a\x00\x00"
        b"\xafpublished_at_ns\xcf\x17\x97\x9c\xfe\x36\x2a\x00\x01"
        b"\xa9speed_mps\xcb\x40\x34\x00\x00\x00\x00\x00\x00"
        b"\xb4speed_variance_m2ps2\xcb\x3f\xc0\x00\x00\x00\x00\x00\x00"
        b"\xaainterval_s\xcb\x3f\x84\x7a\xe1\x47\xae\x14\x7b"
    )
    assert msgpack.unpackb(payload)["measured_at_ns"] == T0
    reading = decode(payload, SpeedReading)
    assert reading.interval_s == 0.01
    loop = sensor("induction_loop", straight_line())
    assert [tuple(o) for o in loop.observe(reading, None)] == [((0.0, 1.0, 0.0), 20.0, 0.125)]
