"""A fuser that was killed and is back knows what the other one knew: a lie under way is not believed anew."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Iterator
from itertools import pairwise

import msgpack
import pytest
import zenoh

from conftest import Outside, Stack, free_port, start
from milepost.runtime.injecting.commands import send_command

pytestmark = pytest.mark.long

TOP = "milepost/v1/full-1"
STATE = f"{TOP}/state"
LIAR = "radar-front"


@pytest.fixture(scope="module")
def full() -> Iterator[tuple[Stack, Outside]]:
    stack, outside = start("deploy/trains/full.yaml", "--listen", f"tcp/127.0.0.1:{free_port()}")
    try:
        outside.wait_state(STATE, lambda m: m["status"] == "normal", 60.0, "a normal state")
        outside.wait_for(lambda: all(outside.newest(f"{TOP}/health/{f}") for f in ("fuser", "fuser-2")), 30.0, "both fusers")
        yield stack, outside
    finally:
        outside.close()
        assert stack.stop() == 0, "".join(stack.errors)


def excludes(state: dict) -> bool:
    return any(entry["unit"] == LIAR for entry in state["excluded"])


def other(fuser: str) -> str:
    return "fuser-2" if fuser == "fuser" else "fuser"


def killed(stack: Stack, outside: Outside, fuser: str) -> set[str]:
    """Kill a fuser; returns its instances so far."""
    before = {m["instance"] for m in outside.messages(f"{TOP}/health/{fuser}")}
    os.kill(stack.pid_of(*(("fuser",) if fuser == "fuser" else ("fuser", fuser))), signal.SIGKILL)
    return before


def back(outside: Outside, fuser: str, before: set[str]) -> None:
    """Wait until a new instance of a fuser has run for two seconds."""

    def found() -> bool:
        return len([m for m in outside.messages(f"{TOP}/health/{fuser}") if m["instance"] not in before]) >= 2

    outside.wait_for(found, 30.0, f"{fuser} again")


Banks = dict[str, dict[int, object]]


def note_banks(outside: Outside, found: Banks) -> None:
    """Note each fuser's bank before the settled boundary, by the time of its last observation: it changes no more."""
    every = {"consolidation": zenoh.ConsolidationMode.NONE, "timeout": 5.0}
    for reply in outside.session.get(f"{TOP}/@rpc/snapshot/*", **every):
        part = msgpack.unpackb(reply.ok.payload.to_bytes()) if reply.ok is not None else {"part": None}
        if part["part"] == 0:
            bank, at_ns = msgpack.unpackb(part["content"])[-1][:2]
            found[str(reply.ok.key_expr).rpartition("/")[2]][at_ns or 0] = bank


def test_a_standby_that_was_restarted_settles_to_the_same_bits(full: tuple[Stack, Outside]) -> None:
    stack, outside = full
    standby = other(outside.newest(STATE)["unit"])
    back(outside, standby, killed(stack, outside, standby))
    begun = outside.newest(STATE)["measured_at_ns"]
    found: Banks = {"fuser": {}, "fuser-2": {}}
    common: list[int] = []
    while not common:
        epoch = outside.newest(STATE)["epoch"]
        assert epoch * 20_000_000 < begun + 60_000_000_000, "no banks of the same moment after the restart"
        outside.wait_state(STATE, lambda m, before=epoch: m["epoch"] > before + 20, 20.0, "0.4 s more")
        note_banks(outside, found)
        common = [at_ns for at_ns in found["fuser"] if at_ns > begun and at_ns in found["fuser-2"]]
    assert found["fuser"][common[0]] == found["fuser-2"][common[0]]


def test_a_standby_that_was_restarted_leads_on_without_the_liar(full: tuple[Stack, Outside]) -> None:
    stack, outside = full
    send_command(stack.endpoints, "full-1", LIAR, {"kind": "bias", "numbers": {"size": 2.0}, "words": {}, "flags": {}})
    outside.wait_state(STATE, excludes, 20.0, f"{LIAR} excluded")
    leader = outside.newest(STATE)["unit"]
    standby = other(leader)
    back(outside, standby, killed(stack, outside, standby))
    told = f"continuing with all that {leader} knew"
    outside.wait_for(lambda: any(told in line for line in stack.errors), 5.0, "the log of the standby")

    begun, events = len(outside.heard[STATE]) - 1, len(outside.messages(f"{TOP}/event"))
    before = killed(stack, outside, leader)
    first = outside.wait_state(STATE, lambda m: m["unit"] == standby, 10.0, "a state of the standby")
    outside.wait_state(STATE, lambda m: m["epoch"] > first["epoch"] + 150, 20.0, "three seconds more")
    # on a busy machine both may speak for a moment: whoever listens keeps the first state of an epoch
    by_epoch: dict[int, dict] = {}
    for _, state in outside.heard[STATE][begun:]:
        by_epoch.setdefault(state["epoch"], state)
    seen = [by_epoch[epoch] for epoch in sorted(by_epoch)]
    assert all(map(excludes, seen)), "the lie was believed anew"
    assert len(seen) == seen[-1]["epoch"] - seen[0]["epoch"] + 1, "an epoch is missing"
    steps = [b["position_m"] - a["position_m"] for a, b in pairwise(seen)]
    # what was awaited when a state was sent moves the next one by centimetres; the lie would move it by metres
    assert max(steps) - min(steps) < 0.3
    assert not any(state["reset"] for state in seen)
    truth = {m["measured_at_ns"]: m for m in outside.messages(f"{TOP}/@sim/truth")}
    compared = [(m, truth[m["measured_at_ns"]]) for m in seen if m["measured_at_ns"] in truth]
    assert compared
    assert all(m["position_min_m"] <= t["position_m"] <= m["position_max_m"] for m, t in compared)
    news = outside.messages(f"{TOP}/event")[events:]
    assert not [event for event in news if event["code"] == "unit_excluded" and LIAR in event["text"]]
    assert not [event for event in news if event["code"] == "snapshot_refused"]
    back(outside, leader, before)


def test_a_forged_snapshot_moves_no_restarted_fuser(full: tuple[Stack, Outside]) -> None:
    """A stranger who answers in the name of a replica, with garbage and the newest stamp: the replica's own answer counts."""
    stack, outside = full
    leader = outside.newest(STATE)["unit"]
    standby = other(leader)
    asked: list[str] = []
    key = f"{TOP}/@rpc/snapshot/{leader}"

    def reply(query) -> None:
        with query:
            asked.append(str(query.selector))
            lie = {
                "fingerprint": "0",
                "taken_at_ns": time.time_ns() + 400_000_000,
                "part": 0,
                "parts": 1,
                "content": b"garbage",
            }
            query.reply(key, msgpack.packb(lie))

    queryable = outside.session.declare_queryable(key, reply)
    try:
        back(outside, standby, killed(stack, outside, standby))
    finally:
        queryable.undeclare()
    assert asked
    events = outside.messages(f"{TOP}/event")
    assert any(event["code"] == "snapshot_refused" and "other settings" in event["text"] for event in events)
    assert sum(f"continuing with all that {leader} knew" in line for line in stack.errors) >= 1
    killed(stack, outside, leader)
    outside.wait_state(STATE, lambda m: m["unit"] == standby, 10.0, "a state of the standby")
    seen = outside.messages(STATE)[-10:]
    assert all(map(excludes, seen))
