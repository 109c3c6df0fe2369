"""Three fusers and a voter, the clock of one of which is wrong: outside nothing is missing, late, or of another time."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise

import pytest
from harness import at
from test_three_fusers import Three

from milepost.nodes.base import Node, Subscription
from milepost.nodes.fuser_faults.wrong_clock import WrongClock

HAPPENS_S, END_S = 4.0, 9.0
WRONG_S = (-3600.0, -0.3, 0.3, 20.0)


def commanded(voter: Node) -> Node:
    """The voter, whose clock commands set wrong as they do a fuser's."""
    node = WrongClock(voter)
    node.subscriptions = [*node.subscriptions, Subscription("chaos", voter.unit)]
    return node


def wrong(unit: str, ahead_s: float, around_voter: Callable[[Node], Node] = lambda node: node) -> Three:
    three = Three(end_s=END_S, around_voter=around_voter)
    three.until(HAPPENS_S)
    three.set_clock(unit, ahead_s, HAPPENS_S)
    return three


def told(three: Three, unit: str) -> list[str]:
    return [event.code for event in three.events if event.unit == unit and event.code.startswith("clock_")]


def longest_gap_s(three: Three) -> float:
    return max(b - a for a, b in pairwise(three.received_ns)) * 1e-9


def all_in_time(three: Three) -> bool:
    """No epoch is missing, or published before it came or more than 0.15 s after."""
    epochs = [state.epoch for state in three.states]
    ages = [now - state.measured_at_ns for state, now in zip(three.states, three.received_ns, strict=True)]
    return epochs == list(range(epochs[0], epochs[0] + len(epochs))) and min(ages) >= 0 and max(ages) <= 150e6


@pytest.mark.parametrize("ahead_s", WRONG_S)
@pytest.mark.parametrize("unit", ["fuser", "fuser-3"])
def test_a_fuser_whose_clock_is_wrong_goes_on_proposing_in_the_others_time(unit: str, ahead_s: float) -> None:
    """GIVEN three fusers WHEN the clock of one is wrong THEN it says so, goes by the others' time, and has its vote."""
    three = wrong(unit, ahead_s)
    three.until(END_S)
    assert told(three, unit) == ["clock_wrong"]
    assert all_in_time(three)
    proposed = [state.measured_at_ns for state in three.proposed[unit] if state.measured_at_ns > at(HAPPENS_S + 1.0)]
    assert len(proposed) >= 0.9 * (END_S - HAPPENS_S - 1.0) / 0.02
    assert three.events_of("fuser_outvoted") == []


@pytest.mark.parametrize("ahead_s", WRONG_S)
def test_where_another_one_dies_meanwhile_two_still_agree(ahead_s: float) -> None:
    """GIVEN a fuser that has gone by the others' time for a while WHEN another one dies THEN every epoch is voted."""
    three = wrong("fuser-2", ahead_s)
    three.until(HAPPENS_S + 2.5)
    three.fusers["fuser"].dead = True
    three.until(END_S)
    assert all_in_time(three)
    assert longest_gap_s(three) <= 0.15
    assert three.events_of("no_majority") == []


@pytest.mark.parametrize("ahead_s", WRONG_S)
def test_a_voter_whose_clock_is_wrong_goes_on_publishing(ahead_s: float) -> None:
    """GIVEN the only voter WHEN its clock is wrong THEN it says so, and goes by the fusers' time."""
    three = wrong("voter", ahead_s, commanded)
    three.until(END_S)
    assert told(three, "voter") == ["clock_wrong"]
    assert all_in_time(three)
    assert longest_gap_s(three) <= 0.15


@pytest.mark.parametrize("ahead_s", [-20.0, 0.3, 20.0])
def test_a_clock_that_is_right_again_is_told(ahead_s: float) -> None:
    """A clock never goes back: one that was ahead stands still until then."""
    three = wrong("fuser-2", ahead_s)
    three.until(HAPPENS_S + 2.0)
    three.set_clock("fuser-2", 0.0, HAPPENS_S + 2.0)
    three.until(END_S)
    assert told(three, "fuser-2") == (["clock_wrong"] if ahead_s == 20.0 else ["clock_wrong", "clock_right"])
    assert all_in_time(three)
