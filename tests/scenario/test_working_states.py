"""What a unit does is named in state and event: it drifts, it comes and goes, it is late."""

from __future__ import annotations

from typing import Any

import pytest
from harness import ROOT, Journey

from milepost.config.train import load_train
from milepost.offline.run import simulate
from milepost.simulation.faults import FaultEntry

ONSET_S, END_S = 10.0, 20.0


def ride(train_name: str, duration_s: float, *faults: dict[str, Any]) -> Journey:
    """A train with faults from `ONSET_S` on."""
    train = load_train(ROOT / f"deploy/trains/{train_name}.yaml")
    journey = Journey(train)
    simulate(train, duration_s, journey.tap, journey.keep, None, [FaultEntry(**{"from_s": ONSET_S, **f}) for f in faults])
    return journey


def kinds(journey: Journey, unit: str, from_s: float = 0.0, to_s: float = 1e6) -> list[str | None]:
    """The kinds of an excluded unit, one after the other."""
    found = [e.kind for state in journey.between(from_s, to_s) for e in state.excluded if e.unit == unit]
    return [kind for place, kind in enumerate(found) if place == 0 or found[place - 1] != kind]


def told(journey: Journey, unit: str, code: str) -> list[str]:
    return [event.text for event in journey.events if event.code == code and event.text.startswith(unit)]


@pytest.mark.parametrize(
    ("train", "fault"),
    [
        ("maglev", {"unit": "radar", "kind": "ramp", "rate": 0.02}),
        ("full", {"unit": "gnss", "kind": "drag", "rate_mps": 0.5}),
    ],
)
def test_a_unit_whose_error_grows_is_drifting(train: str, fault: dict[str, Any]) -> None:
    journey = ride(train, 36.0, fault)
    assert kinds(journey, fault["unit"])[-2:] == ["biased", "drifting"]
    assert f"{fault['unit']} is drifting: its error grew from " in told(journey, fault["unit"], "unit_excluded")[-1]
    assert journey.outside() == []


@pytest.mark.parametrize(("train", "unit"), [("maglev", "radar"), ("metro", "radar-1")])
def test_a_unit_whose_error_comes_and_goes_is_intermittent(train: str, unit: str) -> None:
    journey = ride(train, 25.0, {"unit": unit, "kind": "intermittent", "size": 1.0})
    assert kinds(journey, unit)[-1] == "intermittent"
    assert "is intermittent: it was wrong 3 times within " in told(journey, unit, "unit_excluded")[-1]


@pytest.mark.parametrize("by_s", [1.5, 3.0, 7.0])
@pytest.mark.parametrize("unit", ["radar", "loop"])
def test_a_unit_whose_readings_come_late_is_late(unit: str, by_s: float) -> None:
    """Also where they come after the horizon of 5 s, so that nothing of them counts."""
    journey = ride("maglev", 28.0, {"unit": unit, "kind": "delay", "by_s": by_s, "for_s": END_S - ONSET_S})
    assert kinds(journey, unit) == ["silent", "late"]
    assert kinds(journey, unit, ONSET_S + by_s + 0.1, END_S) == ["late"]
    (text,) = told(journey, unit, "unit_late")
    assert f"its readings come {by_s:.2f} s late" in text or f"its readings come {by_s + 0.01:.2f} s late" in text
    assert told(journey, unit, "unit_heard") == [f"{unit} is heard in time again"]
    assert journey.between(END_S + 1.0, 28.0)[-1].excluded == []


def test_readings_that_come_within_the_horizon_are_in_the_settled_states() -> None:
    journey = ride("maglev", 28.0, {"unit": "radar", "kind": "delay", "by_s": 1.5, "for_s": END_S - ONSET_S})
    assert not any(e.unit == "radar" for state in journey.settled.values() for e in state.excluded)


def test_a_unit_whose_clock_is_ahead_is_refused_not_silent() -> None:
    journey = ride("maglev", 18.0, {"unit": "radar", "kind": "clock_step", "by_s": 2.5})
    assert kinds(journey, "radar") == ["refused"]


def test_a_unit_that_says_nothing_is_silent_with_an_event() -> None:
    journey = ride("maglev", 18.0, {"unit": "radar", "kind": "drop_out", "for_s": 4.0})
    assert kinds(journey, "radar") == ["silent"]
    assert told(journey, "radar", "unit_silent") == ["radar is silent: nothing is heard of it any more"]
    assert told(journey, "radar", "unit_heard") == ["radar is heard in time again"]


@pytest.mark.parametrize("train", ["maglev", "metro"])
def test_nothing_is_told_of_units_that_are_heard_in_time(train: str) -> None:
    journey = ride(train, 12.0)
    assert not {e.code for e in journey.events} & {"unit_silent", "unit_late", "unit_absent", "unit_heard"}
