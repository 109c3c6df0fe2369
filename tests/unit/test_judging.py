"""Readings judged where they stand in the fuser's timeline, and what estimates carry of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from examples import GAUSSIAN, T0, head, sensor, straight_line, surveyed_line
from milepost.estimation.kalman import update
from milepost.estimation.layout import Layout
from milepost.estimation.motion import process_noise, transition
from milepost.estimation.observation import Observation
from milepost.estimation.time_units import NS_PER_S
from milepost.estimation.timeline import Timeline
from milepost.fusion.bank import BankKernel
from milepost.fusion.hypotheses import Doubts, Suspect
from milepost.nodes.judges import UnitJudge
from milepost.nodes.observations import RESTORED_COMPONENT, as_judged, of_estimate, whole_readings
from milepost.sensors.observed import Stacked
from milepost_schemas import Estimate, JudgedReading, LinearObservation, PositionReading, Refused, SpeedReading

MEAN, COVARIANCE = np.array([0.0, 20.0, 0.0]), np.diag([1.0, 4.0, 0.01])
DOUBTS = Doubts((Suspect("u", 1e-4, 10.0), Suspect("v", 1e-4, 10.0)))


class Distrustful:
    """Counts a speed at R = 1 unless it is more than 3 m/s off what is believed; remembers how many it refused."""

    pure = False
    learner = None

    def start(self) -> int:
        return 0

    def restart(self) -> int:
        return 100

    def judge(self, memory: int, reading: float, mean: Any, covariance: Any) -> tuple[Any, int, str | None, str | None]:
        if abs(reading - mean[1]) > 3.0:
            return (), memory + 1, None, "off"
        return [((0.0, 1.0, 0.0), reading, 1.0)], memory, None, None

    def each(self, reading: float, beliefs: Any) -> Any:
        raise NotImplementedError


class Squared:
    """z = v² + e, R = 4, linearised at the belief: h = 2 v, and z - v² + h v in place of z. It remembers nothing."""

    pure = True
    learner = None

    def start(self) -> None:
        return None

    restart = start

    def judge(self, memory: None, reading: float, mean: Any, covariance: Any) -> tuple[Any, None, str | None, str | None]:
        raise NotImplementedError

    def each(self, reading: float, beliefs: Any) -> list[Stacked]:
        v = beliefs.mean(1)
        h = np.stack([0.0 * v, 2.0 * v, 0.0 * v])
        return [Stacked(h, reading + v * v, np.full(len(v), 4.0))]


def timeline(judge: Any = None, doubts: Doubts = DOUBTS) -> Timeline:
    kernel = BankKernel(Layout(), 0.01, {"u": judge or Distrustful()}, doubts, 5.0)
    return Timeline(kernel, kernel.prior(MEAN, COVARIANCE), 5 * NS_PER_S)


def spoken(t_s: float, value: float) -> Observation:
    return Observation(T0 + round(t_s * NS_PER_S), 0, 0, "i", 0, "u", (), reading=value)


def speed(unit: str, t_s: float, value: float) -> Observation:
    return Observation(T0 + round(t_s * NS_PER_S), 1, 0, "i", 0, unit, (0.0, 1.0, 0.0), value, 1.0)


def test_a_reading_counts_at_the_belief_where_it_stands() -> None:
    line = timeline()
    line.insert(spoken(0.0, 21.0), T0)
    state = line.state_at(T0)
    mean, covariance = update(MEAN, COVARIANCE, np.array([0.0, 1.0, 0.0]), 21.0, 1.0)
    believed, known = line.kernel.unpack(state)
    assert believed == pytest.approx(mean)
    assert known == pytest.approx(covariance)
    verdict = state.verdicts["u"]
    assert (verdict.heard_ns, verdict.counted_ns, verdict.gating, verdict.refused) == (T0, T0, None, None)


def test_a_late_reading_changes_what_the_judge_says_of_later_ones() -> None:
    """26 is 6 off the prior's 20, but within 3 of what 22.9 and 25 make of it."""
    line = timeline()
    line.insert(spoken(2.0, 26.0), T0 + 2 * NS_PER_S)
    assert line.state_at(T0 + 2 * NS_PER_S).verdicts["u"].refused == "off"
    for k, value in enumerate((22.9, 25.0, 25.5)):
        line.insert(spoken(0.1 * k, value), T0 + 2 * NS_PER_S)
    verdict = line.state_at(T0 + 2 * NS_PER_S).verdicts["u"]
    assert (verdict.memory, verdict.refused, verdict.counted_ns) == (0, None, T0 + 2 * NS_PER_S)


def test_the_prior_waits_for_the_first_reading_that_counts() -> None:
    line = timeline()
    line.insert(spoken(0.0, 99.0), T0 + NS_PER_S)
    refused = line.state_at(T0 + NS_PER_S)
    assert refused.since_ns is None
    assert line.kernel.unpack(refused)[1] == pytest.approx(COVARIANCE)
    line.insert(spoken(1.0, 20.0), T0 + NS_PER_S)
    assert line.state_at(T0 + NS_PER_S).since_ns == T0 + NS_PER_S


def test_judges_begin_again_on_a_belief_that_is_taken_over() -> None:
    line = timeline()
    state = line.kernel.pack(MEAN, COVARIANCE)
    assert state.verdicts["u"].memory == 100
    assert state.since_ns is not None


def test_a_judge_that_remembers_judges_once_at_the_leading_belief() -> None:
    """With v's 26 the leading belief is 24.8: 20 is refused for all, also for the hypothesis without v, which believes 20."""
    line = timeline()
    line.insert(speed("v", 0.0, 26.0), T0 + NS_PER_S)
    before = line.state_at(T0)
    assert before.rows.sets == (frozenset(), frozenset("u"), frozenset("v"), frozenset("uv"))
    assert before.x[:, 1] == pytest.approx([24.8, 24.8, 20.0, 20.0])
    line.insert(spoken(0.001, 20.0), T0 + NS_PER_S)
    refused = line.state_at(T0 + 1_000_000)
    assert (refused.verdicts["u"].memory, refused.verdicts["u"].refused) == (1, "off")
    assert refused.x[:, 1] == pytest.approx(before.x[:, 1], abs=1e-3)
    line.insert(spoken(0.002, 27.0), T0 + NS_PER_S)
    counted = line.state_at(T0 + 2_000_000)
    assert (counted.verdicts["u"].memory, counted.verdicts["u"].refused) == (1, None)
    # R = 1 beside variances of 0.8 and 4
    assert counted.x[:, 1] == pytest.approx([24.8 + 2.2 * 0.8 / 1.8, 24.8, 20.0 + 7.0 * 0.8, 20.0], abs=1e-2)


def test_a_pure_reading_is_linearised_at_each_hypothesis_own_belief() -> None:
    """The prior of those that hear u first is at its place then, wider by the way: P_ss + (v t)². Who hears nobody moves on."""
    line = timeline(Squared())
    later = COVARIANCE.copy()
    later[0, 0] += (MEAN[1] * 1.0) ** 2
    line.insert(speed("v", 0.0, 21.0), T0 + NS_PER_S)
    line.insert(spoken(1.0, 410.0), T0 + NS_PER_S)
    state = line.state_at(T0 + NS_PER_S)
    F, Q = transition(1.0), process_noise(1.0, 0.01)
    heard = update(MEAN, COVARIANCE, np.array([0.0, 1.0, 0.0]), 21.0, 1.0)
    for units, x, P in zip(state.rows.sets, state.x, state.P, strict=True):
        before = (MEAN, COVARIANCE) if "v" in units else heard
        mean, covariance = F @ before[0], F @ before[1] @ F.T + Q
        if "u" not in units:
            mean, covariance = (MEAN, later) if "v" in units else (mean, covariance)
            h = np.array([0.0, 2.0 * mean[1], 0.0])
            mean, covariance = update(mean, covariance, h, 410.0 + mean[1] ** 2, 4.0)
        np.testing.assert_allclose(x, mean, rtol=1e-12)
        np.testing.assert_allclose(P, covariance, rtol=1e-9, atol=1e-12)


def test_what_no_judge_can_use_is_refused_and_changes_nothing() -> None:
    class Broken:
        memory = None
        gating = refused = None

        def model(self) -> Any:
            return self

        def observe(self, reading: Any, belief: Any) -> Any:
            raise OverflowError

        def observe_each(self, reading: Any, beliefs: Any) -> Any:
            raise OverflowError

        def notices(self) -> list[Any]:
            return []

    judge = UnitJudge(Broken(), SpeedReading)
    assert judge.judge("kept", object(), MEAN, COVARIANCE) == ((), "kept", None, "unusable")
    line = timeline(judge)
    line.insert(speed("v", 0.0, 21.0), T0)
    before = line.state_at(T0)
    line.insert(Observation(T0, 2, 0, "i", 0, "u", (), reading=SpeedReading(**head("u"), speed_max_mps=0.5)), T0)
    state = line.state_at(T0)
    assert state.verdicts["u"].refused == "unusable"
    assert (state.verdicts["u"].heard_ns, state.verdicts["u"].counted_ns) == (T0, None)
    np.testing.assert_array_equal(state.x, before.x)
    np.testing.assert_array_equal(state.P, before.P)


def estimate(reading: SpeedReading, fields: dict[str, Any] | None = None, **changed: Any) -> Estimate:
    judged = as_judged(reading, True, None) | ({} if fields is None else {"fields": fields})
    row = {"sensor_instance": reading.instance, "reading_sequence": reading.sequence, "measured_at_ns": reading.measured_at_ns}
    rows = [
        LinearObservation(**row, component=component, row=[0.0, 1.0, 0.0, 0.0], value=20.0, variance=0.04)
        for component in (0, RESTORED_COMPONENT)
    ]
    return Estimate(**head(), belief=GAUSSIAN, observations=rows, readings=[JudgedReading(**judged)], **changed)


def whole(said: Estimate) -> list[Observation]:
    return whole_readings(said, 3, SpeedReading, of_estimate(said, 3))


def test_a_reading_travels_as_the_sensor_stated_it_and_stands_for_its_rows() -> None:
    reading = SpeedReading(**head(), speed_mps=20.5, speed_variance_m2ps2=0.04)
    stated, restored = whole(estimate(reading))
    assert stated.reading.speed_mps == reading.speed_mps
    assert (stated.order, stated.identity) == (3, ("radar", reading.measured_at_ns, 0))
    assert (restored.component, restored.value) == (RESTORED_COMPONENT, 20.0)


def test_fields_that_are_not_the_sensors_are_refused() -> None:
    reading = SpeedReading(**head(), speed_mps=20.5, speed_variance_m2ps2=0.04)
    with pytest.raises(Refused, match="speed_reading"):
        whole(estimate(reading, {"latitude_deg": 50.0}))


def test_rows_without_readings_count_as_they_come() -> None:
    reading = SpeedReading(**head(), speed_mps=20.5, speed_variance_m2ps2=0.04)
    foreign = estimate(reading).model_copy(update={"readings": []})
    assert [o.component for o in whole(foreign)] == [0, RESTORED_COMPONENT]


def test_the_fuser_judges_a_wheel_without_memory() -> None:
    """Whether a wheel slips, the hypotheses tell: far off, it still has its row."""
    judge = UnitJudge(sensor("odometer", straight_line(), "radar"), SpeedReading)
    slow = SpeedReading(**head(), speed_mps=5.0, speed_variance_m2ps2=0.0004, interval_s=0.05)
    mean, covariance = np.array([0.0, 20.0, 0.0, 0.0]), np.diag([1.0, 1e-4, 1e-4, 1e-6])
    assert judge.pure
    rows, _, gating, refused = judge.judge(judge.start(), slow, mean, covariance)
    assert (len(rows), gating, refused) == (1, None, None)


def test_a_judge_of_a_receiver_remembers_what_it_is_handed() -> None:
    receiver = sensor("gnss", surveyed_line())
    judge = UnitJudge(receiver, PositionReading)
    assert not judge.pure
    reading = PositionReading(**head("gnss"), latitude_deg=50.93, longitude_deg=4.5, solution="differential")
    size = 3 + len(receiver.private_states)
    mean, covariance = np.zeros(size), np.diag([1e6, 4.0, 0.01, *[1.0] * (size - 3)])
    start = judge.start()
    first = judge.judge(start, reading, mean, covariance)
    judge.judge(first[1], reading, mean, covariance)
    assert judge.judge(start, reading, mean, covariance) == first
    assert judge.start() == start


def test_a_reading_that_tells_nothing_is_heard_and_not_refused() -> None:
    """GIVEN a train that stands WHEN the loop cannot tell which way it crossed THEN nobody excludes the loop for it."""

    class Speechless(Squared):
        def each(self, reading: float, beliefs: Any) -> list[Stacked]:
            return []

    line = timeline(Speechless())
    line.insert(speed("v", 0.0, 21.0), T0)
    before = line.state_at(T0)
    line.insert(spoken(0.0, 1.0), T0)
    state = line.state_at(T0)
    verdict = state.verdicts["u"]
    assert (verdict.refused, verdict.heard_ns, verdict.counted_ns) == (None, T0, T0)
    np.testing.assert_array_equal(state.x, before.x)
