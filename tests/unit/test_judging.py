"""Readings judged where they stand in the fuser's timeline, and what estimates carry of them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from milepost.estimation.judging import JudgingKernel

from examples import GAUSSIAN, T0, head, sensor, straight_line
from milepost.estimation.kalman import update
from milepost.estimation.layout import Layout
from milepost.estimation.observation import Observation
from milepost.estimation.scalar import ScalarKernel
from milepost.estimation.time_units import NS_PER_S
from milepost.estimation.timeline import Timeline
from milepost.nodes.judges import UnitJudge
from milepost.nodes.observations import RESTORED_COMPONENT, as_judged, of_estimate, whole_readings
from milepost_schemas import Estimate, JudgedReading, LinearObservation, Refused, SpeedReading

MEAN, COVARIANCE = np.array([0.0, 20.0, 0.0]), np.diag([1.0, 4.0, 0.01])


class Distrustful:
    """Counts a speed at R = 1 unless it is more than 3 m/s off what is believed; remembers how many it refused."""

    def start(self) -> int:
        return 0

    def restart(self) -> int:
        return 100

    def judge(self, memory: int, reading: float, mean: Any, covariance: Any) -> tuple[Any, int, str | None, str | None]:
        if abs(reading - mean[1]) > 3.0:
            return (), memory + 1, None, "off"
        return [((0.0, 1.0, 0.0), reading, 1.0)], memory, None, None


def timeline() -> Timeline:
    kernel = JudgingKernel(ScalarKernel(0.01), Layout(), {"u": Distrustful()})
    return Timeline(kernel, kernel.prior(MEAN, COVARIANCE), 5 * NS_PER_S)


def spoken(t_s: float, value: float) -> Observation:
    return Observation(T0 + round(t_s * NS_PER_S), 0, 0, "i", 0, "u", (), reading=value)


def test_a_reading_counts_at_the_belief_where_it_stands() -> None:
    line = timeline()
    line.insert(spoken(0.0, 21.0), T0)
    state = line.state_at(T0)
    mean, covariance = update(MEAN, COVARIANCE, np.array([0.0, 1.0, 0.0]), 21.0, 1.0)
    believed, known = line.kernel.unpack(state)
    assert believed == pytest.approx(mean)
    assert known == pytest.approx(covariance)
    assert state.verdicts["u"][1:] == (T0, T0, None, None)


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


def test_what_no_judge_can_reckon_with_is_refused_and_nothing_else_happens() -> None:
    class Broken:
        memory = None
        gating = refused = None

        def observe(self, reading: Any, belief: Any) -> Any:
            raise OverflowError

        def notices(self) -> list[Any]:
            return []

        def restarted(self) -> None:
            """Nothing."""

    rows, memory, gating, refused = UnitJudge(Broken(), SpeedReading).judge("kept", object(), MEAN, COVARIANCE)
    assert (rows, memory, gating, refused) == ((), "kept", None, "unusable")


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


def test_a_judge_of_a_real_wheel_remembers_what_it_is_handed() -> None:
    wheel = sensor("odometer", straight_line(), "radar")
    judge = UnitJudge(wheel.observer(), SpeedReading)
    slow = SpeedReading(**head(), speed_mps=5.0, speed_variance_m2ps2=0.0004, interval_s=0.05)
    mean, covariance = np.array([0.0, 20.0, 0.0, 0.0]), np.diag([1.0, 1e-4, 1e-4, 1e-6])
    rows, memory, gating, refused = judge.judge(judge.start(), slow, mean, covariance)
    assert (len(rows), gating, refused) == (0, "sliding", "sliding")
    fast = slow.model_copy(update={"speed_mps": 20.0})
    assert judge.judge(memory, fast, mean, covariance)[2] == "sliding"
    assert judge.judge(judge.start(), fast, mean, covariance)[2] is None
