"""Two fusers, the clock of one of which is wrong: whoever has the right time speaks, and outside nothing is missing or late."""

from __future__ import annotations

from itertools import pairwise

import pytest
from harness import at
from test_two_fusers import END_S, HAPPENS_S, Mortal, Pair, no_epoch_twice_or_missing

from milepost.nodes.base import Node
from milepost.nodes.fuser_faults.wrong_clock import WrongClock
from milepost_schemas import FaultCommand

# seconds by which a clock is wrong; an offset below the lateness at which a leader gives way is only a little unpunctual
WRONG_S = (-2.0, -0.5, -0.2, 0.2, 0.5, 2.0)
# a clock that stays wrong for a second is not that of a busy machine: until then its fuser goes by the others' time
SEEN_S = 1.6


def misled(pair: Pair, unit: str, ahead_s: float, now_s: float) -> None:
    """Set a fuser's clock; right where `ahead_s` is 0."""
    head = {"train": "maglev", "unit": unit, "instance": "test", "sequence": 0}
    head |= {"measured_at_ns": at(now_s), "published_at_ns": at(now_s)}
    fault = {"kind": "wrong_clock", "numbers": {"by_s": ahead_s}} if ahead_s else {}
    (answer,) = {**pair.fusers, **pair.others}[unit].step(FaultCommand(**head, **fault), at(now_s))
    assert answer.message.code == ("fault_injected" if ahead_s else "fault_cleared")


def mortal(node: Node) -> Mortal:
    """A fuser whose clock may be set wrong, and that may die."""
    return Mortal(WrongClock(node))


def codes(pair: Pair, unit: str) -> list[str]:
    return [event.code for event in pair.events if event.unit == unit and event.code.startswith("clock_")]


@pytest.mark.parametrize("wrong_s", WRONG_S)
@pytest.mark.parametrize("unit", ["fuser", "fuser-2"])
def test_the_fuser_with_the_right_time_speaks_alone(unit: str, wrong_s: float) -> None:
    """GIVEN two fusers WHEN the clock of one becomes wrong THEN soon the other one alone speaks, in time, with no gap."""
    pair, right = Pair(WrongClock), {"fuser": "fuser-2", "fuser-2": "fuser"}[unit]
    pair.until(HAPPENS_S)
    misled(pair, unit, wrong_s, HAPPENS_S)
    pair.until(END_S)
    late = [state.unit for state, now in pair.states if now > at(HAPPENS_S + SEEN_S)]
    assert set(late) == {right}
    punctual = [now for state, now in pair.states if abs(now - state.measured_at_ns) <= 70e6]
    assert max(b - a for a, b in pairwise(punctual)) <= 130e6
    assert codes(pair, unit) == ["clock_wrong"]
    assert codes(pair, right) == []


def test_a_fuser_whose_clock_is_right_again_may_lead_again() -> None:
    pair = Pair(WrongClock)
    pair.until(3.0)
    misled(pair, "fuser", 0.3, 3.0)
    pair.until(5.0)
    misled(pair, "fuser", 0.0, 5.0)
    pair.until(7.0)
    assert codes(pair, "fuser") == ["clock_wrong", "clock_right"]
    misled(pair, "fuser-2", 0.3, 7.0)
    pair.until(END_S)
    assert pair.speakers[-1] == "fuser"


def test_messages_that_are_late_for_a_moment_are_no_wrong_clock() -> None:
    """GIVEN a busy machine WHEN all that both hear comes late for half a second THEN nobody is told to set a clock."""
    pair = Pair(WrongClock)
    pair.until(HAPPENS_S)
    for unit in pair.fusers:
        misled(pair, unit, 0.3, HAPPENS_S)
    pair.until(HAPPENS_S + 0.5)
    for unit in pair.fusers:
        misled(pair, unit, 0.0, HAPPENS_S + 0.5)
    pair.until(END_S)
    assert [codes(pair, unit) for unit in pair.fusers] == [[], []]
    assert max(b - a for (_, a), (_, b) in pairwise(pair.states)) <= 0.5e9


def test_where_all_messages_are_late_one_speaks_all_the_same() -> None:
    """Both fusers are cut off by the same slow link: neither can tell it from a clock that is ahead."""
    pair = Pair(WrongClock)
    pair.until(HAPPENS_S)
    for unit in pair.fusers:
        misled(pair, unit, 0.2, HAPPENS_S)
    pair.until(END_S)
    assert len({state.unit for state, now in pair.states if now > at(END_S - 2.0)}) == 1
    assert max(b - a for (_, a), (_, b) in pairwise(pair.states)) <= 0.35e9


@pytest.mark.parametrize("wrong_s", [-3600.0, -30.0, 20.0, 3600.0])
def test_a_clock_that_was_far_off_leaves_nothing_behind(wrong_s: float) -> None:
    """GIVEN a leader whose clock was an hour off WHEN the other fuser dies THEN it leads as if nothing had been."""
    pair = Pair(mortal)
    pair.until(3.0)
    misled(pair, "fuser", wrong_s, 3.0)
    pair.until(5.0)
    misled(pair, "fuser", 0.0, 5.0)
    pair.until(7.0)
    pair.fusers["fuser-2"].dead = True
    pair.token("fuser-2", False)
    pair.until(END_S)
    # a clock never goes back: one that was ahead stands still, and is still wrong
    assert codes(pair, "fuser") == ["clock_wrong", "clock_right"][: 2 if wrong_s < 0.0 else 1]
    assert pair.speakers == ["fuser", "fuser-2", "fuser"]
    assert {state.status for state, now in pair.states if now > at(1.0)} == {"normal"}
    assert all(state.measured_at_ns <= now for state, now in pair.states), "a state of an epoch that has not come yet"
    assert no_epoch_twice_or_missing(pair)
    assert pair.longest_gap_ms() <= 130.0


@pytest.mark.parametrize("wrong_s", [-20.0, 20.0, 3600.0])
def test_where_the_other_one_is_stopped_meanwhile_no_state_is_of_another_time(wrong_s: float) -> None:
    """A fuser whose clock is wrong goes by the others' messages, so it can speak where nobody else does."""
    pair = Pair(mortal)
    pair.until(3.0)
    misled(pair, "fuser-2", wrong_s, 3.0)
    pair.until(HAPPENS_S)
    pair.fusers["fuser"].stopped_until_ns = at(HAPPENS_S + 1.0)
    pair.until(HAPPENS_S + 2.0)
    misled(pair, "fuser-2", 0.0, HAPPENS_S + 2.0)
    pair.until(END_S)
    assert all(0 <= now - state.measured_at_ns <= 600e6 for state, now in pair.states)
    assert {state.status for state, now in pair.states if now > at(1.0)} == {"normal"}
    assert pair.longest_gap_ms() <= 600.0
    assert codes(pair, "fuser") == []


@pytest.mark.parametrize("wrong_s", [-3600.0, -2.0, -0.3, 0.3, 2.0, 3600.0])
def test_a_filter_on_a_host_with_a_wrong_clock_is_of_use(wrong_s: float) -> None:
    """GIVEN a train on several hosts WHEN the clock of a filter's is wrong THEN it goes by the others' time, and says so.

    One two seconds behind took every reading for one from the future, and its unit fell silent.
    """
    pair = Pair(filter=WrongClock)
    pair.until(3.0)
    misled(pair, "filter-radar", wrong_s, 3.0)
    pair.until(END_S)
    told = [event for event in pair.events if event.code == "clock_wrong"]
    assert [event.text.partition(":")[0] for event in told] == ["filter-radar"]
    assert {state.status for state, now in pair.states if now > at(3.0)} == {"normal"}
    assert not any(state.excluded for state, now in pair.states if now > at(3.0))
    assert no_epoch_twice_or_missing(pair)
