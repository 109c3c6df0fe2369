"""A train brakes harder than its motion model says: its honest sensors stay in use, and the truth stays inside."""

from __future__ import annotations

from functools import cache

import pytest
from harness import ROOT, Journey, scenario_s, travel

from milepost.fusion.hypotheses import MOTION_MODEL

pytestmark = pytest.mark.long

# 4 m/s² at once, which no train does, for 2 s
BRAKE_S, BY_MPS, FOR_S = 15.0, 8.0, 2.0

each_train = pytest.mark.parametrize("name", ["maglev", "metro", "full"])


@cache
def braked(name: str, seed: int = 1) -> Journey:
    """A train that brakes, and goes on at a steady speed."""
    file = ROOT / f"deploy/trains/{name}.yaml"
    begin = {"maglev": 20.0, "metro": 22.2, "full": 12.0}[name]
    profile = [[0.0, begin], [BRAKE_S, begin], [BRAKE_S + FOR_S, begin - BY_MPS], [60.0, begin - BY_MPS]]
    return travel(28.0, change={"world": {"seed": seed, "motion": {"profile": profile}}}, train_file=file)


@each_train
@pytest.mark.parametrize("seed", [1, 2])
def test_the_truth_stays_inside(name: str, seed: int) -> None:
    assert braked(name, seed).outside() == []


@each_train
def test_the_motion_model_is_set_aside_and_used_again(name: str) -> None:
    journey = braked(name)
    codes = [event.code for event in journey.events if event.code.startswith("motion_model")]
    assert codes[:2] == ["motion_model_exceeded", "motion_model_used_again"]
    states = [state for _, state in sorted(journey.live.items())]
    reported = [state for state in states if any(e.unit == MOTION_MODEL for e in state.excluded)]
    assert {(e.reason, s.status) for s in reported for e in s.excluded if e.unit == MOTION_MODEL} == {("exceeded", "degraded")}
    assert states[-1].status == "normal"


@each_train
def test_no_sensor_is_left_out_for_longer_than_a_second(name: str) -> None:
    states = [state for _, state in sorted(braked(name).live.items()) if scenario_s(state) > 5.0]
    period_s = braked(name).train.file.fusion.period_ms / 1000.0
    units = {e.unit for state in states for e in state.excluded} - {MOTION_MODEL}
    for unit in units:
        left_out = [any(e.unit == unit for e in state.excluded) for state in states]
        runs = "".join("x" if out else " " for out in left_out).split()
        assert max(len(run) for run in runs) * period_s <= 1.0, unit
