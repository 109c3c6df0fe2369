"""Two live fusers and two routers: a dispatch tool sees neither a hole nor a step where one of them is killed or stopped."""

from __future__ import annotations

import os
import signal
from collections import Counter
from itertools import pairwise

import pytest

from conftest import Outside, Stack, free_port, running
from lighter import PERIOD_MS, lighter

STATE = "milepost/v1/full-1/state"
# four epochs and the deadline are 255 ms; a busy machine adds its own stalls. One fuser alone: 1.8 s
LONGEST_GAP_S = 1.0


@pytest.fixture(scope="module")
def full(tmp_path_factory):
    file = lighter("full", tmp_path_factory.mktemp("train"))
    with running(str(file), STATE, "--listen", f"tcp/127.0.0.1:{free_port()}") as train:
        yield train


def epochs_of(seconds: float) -> int:
    return round(seconds * 1000 / PERIOD_MS)


def leader(outside: Outside) -> str:
    return outside.newest(STATE)["unit"]


def pid_of(stack: Stack, fuser: str) -> int:
    return stack.pid_of("fuser") if fuser == "fuser" else stack.pid_of("fuser", fuser)


def reached(outside: Outside, epoch: int) -> None:
    outside.wait_state(STATE, lambda m: m["epoch"] > epoch, 10.0, "later states")


def standing_by(stack: Stack, outside: Outside) -> None:
    """Wait until the fuser that does not lead is there, and has a second of its own."""
    key = f"milepost/v1/full-1/health/{'fuser-2' if leader(outside) == 'fuser' else 'fuser'}"
    begun = len(outside.messages(key))
    outside.wait_for(lambda: len(outside.messages(key)) >= begun + 3, 20.0, "three healths of the standby")


@pytest.mark.parametrize("how", ["killed", "stopped"])
def test_the_standby_continues(full, how: str) -> None:
    stack, outside = full
    standing_by(stack, outside)
    old, begun = leader(outside), len(outside.heard[STATE]) - 1
    pid = pid_of(stack, old)
    os.kill(pid, signal.SIGKILL if how == "killed" else signal.SIGSTOP)
    try:
        new = outside.wait_state(STATE, lambda m: m["unit"] != old, 10.0, "a state of the standby")
        outside.wait_state(STATE, lambda m: m["epoch"] > new["epoch"] + epochs_of(2.0), 10.0, "two seconds more")
    finally:
        if how == "stopped":
            os.kill(pid, signal.SIGCONT)
    outside.wait_state(STATE, lambda m: m["epoch"] > new["epoch"] + epochs_of(5.0), 10.0, "three seconds with both")

    seen = outside.heard[STATE][begun:]
    epochs = [message["epoch"] for _, message in seen]
    assert set(epochs) == set(range(epochs[0], epochs[-1] + 1)), "an epoch is missing"
    assert max(Counter(epochs).values()) == 1, "an epoch was sent twice"
    assert epochs == sorted(epochs)
    assert {message["status"] for _, message in seen} == {"normal"}
    assert max(b - a for (a, _), (b, _) in pairwise(seen)) / 1e9 < LONGEST_GAP_S
    assert {message["unit"] for _, message in seen[-epochs_of(2.0) :]} == {new["unit"]}, "the one that comes back stands by"
    steps = [b["position_m"] - a["position_m"] for (_, a), (_, b) in pairwise(seen)]
    assert max(steps) - min(steps) < 0.3


def test_a_standby_that_is_stopped_for_a_moment_repeats_nothing(full) -> None:
    """What the leader has said meanwhile waits to be read: that is no silence."""
    stack, outside = full
    standing_by(stack, outside)
    begun, leads = len(outside.heard[STATE]) - 1, leader(outside)
    pid = pid_of(stack, "fuser-2" if leads == "fuser" else "fuser")
    # the lease is 0.5 s, and the last sign of life before the stop up to a quarter of it old
    for stopped_s in (0.3, 0.4, 0.4, 0.5):
        first = outside.newest(STATE)["epoch"]
        os.kill(pid, signal.SIGSTOP)
        try:
            reached(outside, first + epochs_of(stopped_s))
        finally:
            os.kill(pid, signal.SIGCONT)
        reached(outside, first + epochs_of(stopped_s + 1.0))
    seen = [message for _, message in outside.heard[STATE][begun:]]
    assert {message["unit"] for message in seen} == {leads}
    assert [message["epoch"] for message in seen] == list(range(seen[0]["epoch"], seen[-1]["epoch"] + 1))


# the lease is 0.5 s and a router that says nothing is given up after 0.3 s; one router alone: 1.8 s and 2.3 s
@pytest.mark.parametrize(("how", "longest_s"), [("killed", LONGEST_GAP_S), ("stopped", 1.5)])
def test_everybody_goes_on_with_the_other_router(full, how: str, longest_s: float) -> None:
    stack, outside = full
    outside.wait_state(STATE, lambda m: m["status"] == "normal", 20.0, "a normal state")
    begun = len(outside.heard[STATE]) - 1
    pid = stack.pid_of("router")
    os.kill(pid, signal.SIGKILL if how == "killed" else signal.SIGSTOP)
    try:
        first = outside.newest(STATE)["epoch"]
        outside.wait_state(STATE, lambda m: m["epoch"] > first + epochs_of(3.0), 10.0, "three seconds more")
    finally:
        if how == "stopped":
            os.kill(pid, signal.SIGCONT)
    outside.wait_state(STATE, lambda m: m["status"] == "normal", 20.0, "normal again")
    seen = outside.heard[STATE][begun:]
    assert max(b - a for (a, _), (b, _) in pairwise(seen)) / 1e9 < longest_s
    epochs = [message["epoch"] for _, message in seen]
    assert epochs == sorted(epochs)
    truth = {m["measured_at_ns"]: m for m in outside.messages("milepost/v1/full-1/@sim/truth")}
    compared = [(m, truth[m["measured_at_ns"]]) for _, m in seen if m["measured_at_ns"] in truth]
    assert compared
    assert all(m["position_min_m"] <= t["position_m"] <= m["position_max_m"] for m, t in compared)


def test_a_world_that_is_killed_comes_back_and_the_truth_goes_on(full) -> None:
    stack, outside = full
    truth = "milepost/v1/full-1/@sim/truth"
    old, begun = outside.there(truth), len(outside.messages(STATE))
    os.kill(stack.pid_of("world"), signal.SIGKILL)
    outside.wait_for(lambda: outside.newest(truth)["instance"] != old["instance"], 20.0, "the truth of another world")
    first = next(m for m in outside.messages(truth) if m["instance"] != old["instance"])
    outside.wait_for(lambda: len(outside.messages(STATE)) > begun + epochs_of(8.0), 20.0, "eight seconds of states")
    away_s = (first["measured_at_ns"] - old["measured_at_ns"]) / 1e9
    assert 0.0 < away_s < 5.0
    # the train has gone on meanwhile, as its sensors say
    assert first["position_m"] - old["position_m"] == pytest.approx(away_s * old["speed_mps"], rel=0.2)
    known = {m["measured_at_ns"]: m for m in outside.messages(truth) if m["instance"] == first["instance"]}
    compared = [(m, known[m["measured_at_ns"]]) for m in outside.messages(STATE)[begun:] if m["measured_at_ns"] in known]
    assert compared
    assert all(m["position_min_m"] <= t["position_m"] <= m["position_max_m"] for m, t in compared)
