"""Containers that crash or stand still, as a dispatch tool that knows both routers sees it."""

from __future__ import annotations

import time
from itertools import pairwise

import pytest
from containers import Stack, check_against_truth, is_whole
from engine import run

pytestmark = pytest.mark.compose

STOP_S = 2.0
BACK_S = 5.0
# what other work on the machine may add to a gap
SHARED_S = 0.3


def leader(stack: Stack) -> str:
    return str(stack.listener.states[-1][1]["unit"])


def crash(stack: Stack, service: str) -> None:
    """PID 1 is the engine's init; its child is the process."""
    stack.inside(service, "kill -KILL $(cat /proc/1/task/1/children)")


def stand_still(stack: Stack, service: str) -> None:
    run(["docker", "pause", stack.container(service)], 30.0)
    try:
        time.sleep(STOP_S)
    finally:
        run(["docker", "unpause", stack.container(service)], 30.0)


@pytest.mark.parametrize(
    ("how", "who", "longest_s"),
    [
        (crash, "fuser that leads", 0.1),
        (stand_still, "fuser that leads", 0.3),
        (crash, "router", 0.3),
        (stand_still, "router", 1.0),
        (crash, "sensor-gnss", 0.1),
        (stand_still, "filter-odometer-rear", 0.1),
    ],
)
def test_states_go_on_and_the_truth_stays_inside(stack: Stack, how, who: str, longest_s: float) -> None:
    listener = stack.listener
    before = listener.wait_for_state(is_whole, 60.0, "a normal state to begin with")
    service, tokens = (leader(stack) if who == "fuser that leads" else who), len(listener.tokens)
    how(stack, service)
    struck_at = time.monotonic()
    if how is crash and who != "router":
        listener.wait(
            lambda: any(process == service and alive for process, _, alive in listener.tokens[tokens:]),
            20.0,
            f"the token of the next {service}",
        )
        back_s = next(at for process, at, alive in listener.tokens[tokens:] if process == service and alive) - struck_at
        stack.figures[f"{service} back after s"] = back_s
        assert back_s < BACK_S
    after = listener.wait_for_state(is_whole, 30.0, "a normal state again")
    listener.span(after, epochs=100)
    heard = listener.states[before:]
    check_against_truth(stack, heard)
    newest = [heard[0]]
    for entry in heard[1:]:
        if entry[1]["epoch"] > newest[-1][1]["epoch"]:
            newest.append(entry)
    gap_s = max(b - a for (a, _), (b, _) in pairwise(newest))
    stack.figures[f"{who} {how.__name__}: longest gap s"] = gap_s
    assert gap_s < longest_s + SHARED_S
