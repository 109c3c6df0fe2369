"""The train with everything, offline: whom its states name, from the first moment, and whom they do not."""

from __future__ import annotations

from typing import Any

import pytest
from harness import ROOT, Journey, at, travel

FULL = ROOT / "deploy/trains/full.yaml"
SLIDE_S = (8.0, 11.0)
CHANGE: dict[str, Any] = {
    "world": {"creep": {"events": [{"from_s": SLIDE_S[0], "to_s": SLIDE_S[1], "ratio": -0.3, "units": ["odometer-front"]}]}}
}


@pytest.fixture(scope="module")
def journey() -> Journey:
    """Fourteen seconds in which one wheel slides and nothing else happens."""
    return travel(14.0, change=CHANGE, train_file=FULL)


def test_no_state_of_a_healthy_train_awaits_anybody(journey: Journey) -> None:
    assert {unit for state in journey.live.values() for unit in state.awaiting} == set()


def test_a_sliding_wheel_is_excluded_as_sliding_from_the_moment_of_its_event(journey: Journey) -> None:
    (slide,) = (event for event in journey.events if event.code == "wheel_slide")
    (grips,) = (
        event for event in journey.events if event.code == "wheel_grips" and event.measured_at_ns > slide.measured_at_ns
    )
    held_back = [ns for ns, s in journey.live.items() if any(e.unit == "odometer-front" for e in s.excluded)]
    reasons = [e.reason for s in journey.live.values() for e in s.excluded if e.unit == "odometer-front"]
    # the first reading that is too far off does not yet tell how the wheel slips
    assert set(reasons[5:]) == {"sliding"}
    assert "sliding" in reasons
    # a reading is in the state of the next epoch
    assert at(SLIDE_S[0]) < held_back[0] <= slide.measured_at_ns + 40_000_000
    # the fuser's probation is a second, its filter's half a second
    assert abs(held_back[-1] - grips.measured_at_ns) <= 600_000_000


@pytest.mark.parametrize(("kind", "within_ns"), [("adaptive_kalman", 60_000_000), ("rls", 200_000_000)])
def test_a_wheel_whose_noise_is_learned_is_sliding_too(kind: str, within_ns: int) -> None:
    """A smoothed speed lags behind the slip that it should show."""
    learning = {**CHANGE, "units": {"odometer-front": {"filter": kind}}}
    journey = travel(12.0, change=learning, train_file=FULL)
    (slide,) = (event for event in journey.events if event.code == "wheel_slide")
    for states in (journey.live, journey.settled):
        named = {ns: e.reason for ns, s in states.items() for e in s.excluded if e.unit == "odometer-front"}
        # settled states begin before the wheel's first reading
        reasons = {ns: reason for ns, reason in named.items() if ns > at(1.0)}
        assert set(reasons.values()) <= {"sliding", "jumping", "biased", "noisy"}
        assert reasons[at(0.5 * (SLIDE_S[0] + SLIDE_S[1]))] == "sliding"
        assert min(reasons) <= slide.measured_at_ns + within_ns


def test_settled_states_exclude_the_wheel_for_the_same_reason(journey: Journey) -> None:
    middle = journey.settled[at(0.5 * (SLIDE_S[0] + SLIDE_S[1]))]
    assert [(e.unit, e.reason) for e in middle.excluded] == [("odometer-front", "sliding")]
