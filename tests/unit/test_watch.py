"""What the live table says."""

from __future__ import annotations

import io
import time
from typing import Any

import pytest
from rich.console import Console

from examples import EXAMPLES, head
from milepost.cli.showing.arrivals import Arrivals
from milepost.cli.showing.watch import Screen
from milepost.cli.status import _line
from milepost.runtime import instances
from milepost.runtime.instances import Token
from milepost_schemas import FusedState, Health, Message


def picture(screen: Screen) -> str:
    drawn = io.StringIO()
    Console(width=160, file=drawn).print(screen.render())
    return drawn.getvalue()


def shown(screen: Screen, *messages: Message) -> str:
    for message in messages:
        screen.receive("", message, time.time_ns())
    return picture(screen)


def health(**rates: Any) -> Health:
    fields = {**EXAMPLES["health"][0].model_dump(), **head("filter-radar"), "sent_hz": {}, **rates}
    return Health.model_validate(fields)


@pytest.mark.parametrize(
    ("received", "words"),
    [({"speed_reading": 99.0}, "99 Hz"), ({"speed_reading": 42.0}, "42 of 100 Hz"), ({}, "0 of 100 Hz")],
    ids=["as expected", "slow", "silent"],
)
def test_a_rate_below_the_expected_one_is_shown_beside_it(received: dict[str, float], words: str) -> None:
    line = shown(Screen(), EXAMPLES["state"][0], health(received_hz=received, expected_hz={"speed_reading": 100.0}))
    (row,) = [line for line in line.splitlines() if line.strip().startswith("radar")]
    assert words in row
    assert ("of 100 Hz" in row) == ("of" in words)


def test_the_rate_of_a_unit_without_one_is_shown_alone() -> None:
    line = shown(Screen(), EXAMPLES["state"][0], health(received_hz={"speed_reading": 3.0}, expected_hz={}))
    assert " 3 Hz" in line


def test_a_second_instance_stays_on_the_table_until_it_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(instances, "OVERLAP_S", 0.0)
    screen = Screen()
    shown(screen, EXAMPLES["state"][0])
    for instance in ("b2", "a1"):
        screen.alive(Token("maglev-1", "fuser", instance), True)
    sentence = "maglev-1: fuser has 2 instances (a1, b2): end all but one"
    assert sentence in picture(screen)
    assert sentence in screen.lines()
    screen.alive(Token("maglev-1", "fuser", "b2"), False)
    assert "instances" not in picture(screen)


def test_while_there_is_no_state_it_names_whom_it_waits_for() -> None:
    screen = Screen()
    screen.arrivals = Arrivals(["router", "fuser", "world"], ["maglev-1"], screen.say, lambda: 1.0)
    screen.arrivals.came("fuser")
    assert "waiting for router, world" in picture(screen)
    assert "fuser is there (1 of 3)" in picture(screen)
    screen.arrivals.came("router")
    screen.arrivals.came("world")
    assert "waiting for a state" in picture(screen)


def test_several_trains_are_rows_of_one_table_in_the_order_of_their_names() -> None:
    screen, state = Screen(), EXAMPLES["state"][0]
    event = EXAMPLES["event"][0]
    late = state.model_copy(update={"train": "a-late-one", "position_m": 12.5})
    lines = shown(screen, state, late, event).splitlines()
    rows = [line.split()[0] for line in lines if line.split() and line.split()[0] in ("maglev-1", "a-late-one")]
    assert rows == ["a-late-one", "maglev-1"]
    assert f"{event.train} {event.unit}: {event.text}"[:60] in "\n".join(lines)
    assert [line.split()[0] for line in screen.lines()] == ["a-late-one", "maglev-1"]


def test_a_train_that_has_fallen_silent_is_no_line_as_if_it_spoke() -> None:
    screen, state = Screen(), EXAMPLES["state"][0]
    screen.receive("", state, time.time_ns() - 7_000_000_000)
    assert screen.lines() == [f"{state.train} stale: no state for 7 s, last at {state.position_m:.2f} m"]


def test_units_that_contradict_each_other_are_shown_as_doubted() -> None:
    state = EXAMPLES["state"][0]
    assert "radar" in state.doubted
    (row,) = (line for line in shown(Screen(), state).splitlines() if line.strip().startswith("radar "))
    assert "doubted" in row


def test_status_says_that_one_of_the_doubted_is_wrong() -> None:
    assert "one of radar, loop is wrong" in _line(EXAMPLES["state"][0])


def test_status_tells_units_that_are_wrong_from_those_that_are_silent() -> None:
    entries = [("radar", "biased", "biased"), ("loop", "process gone", "absent")]
    fields = [{"unit": unit, "reason": reason, "kind": kind} for unit, reason, kind in entries]
    state = FusedState.model_validate({**EXAMPLES["state"][0].model_dump(), "excluded": fields})
    assert "; excluded: radar (biased); not heard: loop (process gone)" in _line(state)


def test_status_names_the_units_before_whose_reading_the_state_was_sent() -> None:
    state = EXAMPLES["state"][0]
    assert "; sent before loop had come" in _line(state)
    assert "sent before" not in _line(state.model_copy(update={"awaiting": []}))
