"""How late a process's turn is."""

from __future__ import annotations

import time

import pytest

from milepost.runtime.clock import Clock, Turn
from milepost_schemas import SimulationStart

S = 1_000_000_000


def test_a_message_that_waited_says_so_though_the_clock_does_not_go_back() -> None:
    turn = Turn(Clock())
    came = time.time_ns() - 3 * S
    begun = turn.begin(came)
    assert begun > came + 2 * S
    assert turn.waited_ns == pytest.approx(3 * S, abs=S)
    assert 0 <= turn.spent_ns() < S


def test_without_a_message_nothing_waited() -> None:
    turn = Turn(Clock())
    turn.begin(time.time_ns() - 3 * S)
    turn.begin()
    assert turn.waited_ns == 0


def test_steady_time_passes_as_fast_as_scenario_time() -> None:
    starts = (SimulationStart(start_ns=S, speed=speed, end_ns=2 * S) for speed in (10.0, 1.0))
    fast, real = (Turn(Clock(start)) for start in starts)
    assert fast.steady_ns(0) == pytest.approx(10 * real.steady_ns(0), rel=1e-3)
