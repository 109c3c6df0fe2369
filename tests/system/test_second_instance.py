"""A process that runs twice is an error that everybody sees, and one that was restarted is not."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading

import pytest

from conftest import Outside

pytestmark = pytest.mark.long

TRAIN = "deploy/trains/maglev.yaml"
TOP = "milepost/v1/maglev-1"


def command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "milepost", *arguments]


def status(endpoint: str, *options: str) -> subprocess.CompletedProcess:
    return subprocess.run(command("status", "--connect", endpoint, *options), capture_output=True, text=True, timeout=30)


def events(outside: Outside, code: str) -> list[dict]:
    return [event for event in outside.messages(f"{TOP}/event") if event["code"] == code]


@pytest.mark.parametrize("words", [("filter", "radar"), ("fuser",), ("sensor", "loop")], ids="-".join)
def test_a_second_instance_is_seen_by_all_and_its_end_too(maglev, words) -> None:
    stack, outside = maglev
    name = "-".join(words)
    before = len(events(outside, "second_instance"))
    gone_before = len(events(outside, "one_instance"))
    second = subprocess.Popen(
        command("run", *words, "--train", TRAIN, "--connect", stack.endpoint), stderr=subprocess.PIPE, text=True
    )
    said: list[str] = []
    threading.Thread(target=lambda: said.extend(second.stderr), daemon=True).start()
    # who speaks: the fuser, which sees all, and the newcomer; two fusers see each other
    outside.wait_for(lambda: len(events(outside, "second_instance")) >= before + 2, 20.0, "two events")
    new = events(outside, "second_instance")[before:]
    assert {event["severity"] for event in new} == {"error"}
    assert all(event["text"].startswith(f"{name} has 2 instances (") for event in new)
    assert len({event["instance"] for event in new}) == 2
    outside.wait_for(lambda: any("has 2 instances" in line for line in said), 5.0, "the newcomer's line")

    look = status(stack.endpoint, "--json")
    assert look.returncode == 1
    assert f"maglev-1: {name} has 2 instances (" in look.stderr
    (fields,) = json.loads(look.stdout)
    assert list(fields["second_instances"]) == [name]
    watch = subprocess.Popen(command("watch", "--connect", stack.endpoint), stdout=subprocess.PIPE, text=True)
    assert next(line for line in watch.stdout if f"{name} has 2 instances" in line)
    watch.send_signal(signal.SIGINT)
    watch.communicate(timeout=10.0)

    second.send_signal(signal.SIGTERM)
    assert second.wait(5.0) == 0
    outside.wait_for(lambda: len(events(outside, "one_instance")) > gone_before, 5.0, "the event that it is gone")
    assert len(events(outside, "second_instance")) == before + 2, "once, not every second"
    outside.wait_state(f"{TOP}/state", lambda m: m["status"] == "normal", 20.0, "normal again")
    again = status(stack.endpoint)
    assert (again.returncode, again.stderr) == (0, "")


def test_a_restart_after_a_kill_is_no_second_instance(maglev) -> None:
    stack, outside = maglev
    before = len(events(outside, "second_instance"))
    for words in (("filter", "loop"), ("fuser",)):
        key = f"{TOP}/health/{'-'.join(words)}"
        old = outside.there(key)["instance"]
        os.kill(stack.pid_of(*words), signal.SIGKILL)
        outside.wait_for(lambda key=key, old=old: outside.newest(key)["instance"] != old, 20.0, "the successor's health")
    begun = len(outside.messages(f"{TOP}/health/fuser"))
    outside.wait_for(lambda: len(outside.messages(f"{TOP}/health/fuser")) >= begun + 3, 10.0, "three healths of the fuser")
    assert len(events(outside, "second_instance")) == before
    outside.wait_state(f"{TOP}/state", lambda m: m["status"] == "normal", 20.0, "normal again")


def test_world_names_in_an_event_whom_it_waits_for(router) -> None:
    outside = Outside(router)
    outside.listen("milepost/v1/**")
    world = subprocess.Popen(command("run", "world", "--train", TRAIN, "--connect", router), stderr=subprocess.PIPE, text=True)
    outside.wait_for(lambda: events(outside, "waiting_for"), 20.0, "the event")
    (event,) = events(outside, "waiting_for")
    assert event["unit"] == "world"
    assert event["text"].startswith("waiting for balise, filter-loop, filter-radar, fuser, sensor-balise-reader, ")
    world.send_signal(signal.SIGTERM)
    assert event["text"] in world.communicate(timeout=5.0)[1]
    assert world.returncode == 0
    outside.close()
