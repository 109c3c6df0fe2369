"""Containers that crash or stand still, as a dispatch tool that knows both routers sees it."""

from __future__ import annotations

import time
from itertools import pairwise

import pytest
from containers import Stack, advancing, check_against_truth, is_whole
from engine import run

pytestmark = pytest.mark.compose

STOP_S = 2.0
BACK_S = 5.0
# A container that starts again takes a core for seconds, and the machine's own stalls come on top: what is asked here is that
# nobody waits for the one that is gone (a fuser 3 s, a router 2 s). Gaps to the millisecond are the chaos matrix's.
LONGEST_GAP_S = 1.0


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
        (crash, "fuser that leads", LONGEST_GAP_S),
        (stand_still, "fuser that leads", LONGEST_GAP_S),
        (crash, "router", LONGEST_GAP_S),
        # its lease of 0.5 s, and 0.3 s until the next one is tried
        (stand_still, "router", 1.5),
        (crash, "sensor-gnss", LONGEST_GAP_S),
        (stand_still, "filter-odometer-rear", LONGEST_GAP_S),
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
    gap_s = max(b - a for (a, _), (b, _) in pairwise(advancing(heard)))
    stack.figures[f"{who} {how.__name__}: longest gap s"] = gap_s
    assert gap_s < longest_s
