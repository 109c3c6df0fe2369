"""`milepost up --together`: the same nodes on one session in one process, and what outsiders see of it."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
import yaml

from conftest import Outside, Stack, free_port, running
from examples import EXAMPLES
from milepost.recorder.reading import recordings_in
from milepost.recorder.summary import Summary
from milepost_schemas import Feedback, decode, encode, rpc_key

TRAIN, TOP = "regional", "milepost/v1/regional-1"
DURATION_S = 8
EPOCH_FIELDS = {"measured_at_ns", "published_at_ns", "sequence", "epoch"}


def milepost(*words: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-m", "milepost", *map(str, words)]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


@pytest.fixture(scope="module")
def together() -> Iterator[tuple[Stack, Outside]]:
    """A train of ten processes in one, running; a test finds it normal and leaves it so."""
    with running(TRAIN, f"{TOP}/state", "--together") as train:
        yield train


def test_all_nodes_of_a_train_are_in_one_process_and_each_has_its_token(together: tuple[Stack, Outside]) -> None:
    stack, outside = together
    assert psutil.pid_exists(stack.pid_of("together"))
    with pytest.raises(LookupError):
        stack.pid_of("fuser")
    names = {key.split("/")[-2] for key, there in outside.tokens.items() if there}
    units = ("odometer-front", "odometer-rear", "radar")
    expected = {f"{role}-{unit}" for role in ("sensor", "filter") for unit in units}
    assert names == expected | {"sensor-balise-reader", "fuser", "balise", "etcs", "world"}


def test_status_finds_it_normal(together: tuple[Stack, Outside]) -> None:
    stack, _ = together
    done = milepost("status", "--json", "--connect", stack.endpoint)
    assert done.returncode == 0, done.stdout + done.stderr


def test_nothing_is_lost_refused_or_heard_twice_inside(together: tuple[Stack, Outside]) -> None:
    """Every node hears each message of the others once, in order, though all of them speak on one session."""
    _, outside = together
    fuser = outside.there(f"{TOP}/health/fuser")
    assert (fuser["gaps"], fuser["refused"]) == (0, {})
    for unit in ("odometer-front", "radar"):
        # a filter reads only the newest feedback, so it has gaps
        assert outside.there(f"{TOP}/health/filter-{unit}")["refused"] == {}
        numbers = [m["sequence"] for m in outside.messages(f"{TOP}/estimate/{unit}")]
        assert numbers == sorted(set(numbers))


def test_its_nodes_do_not_all_send_their_health_at_once(together: tuple[Stack, Outside]) -> None:
    """Of a fleet's thousands at once, what does not fit into the queue of its session is dropped: no recorder hears it."""
    _, outside = together
    names = {key.split("/")[-2] for key, there in outside.tokens.items() if there}
    sent_ns = sorted(outside.there(f"{TOP}/health/{name}")["published_at_ns"] % 1_000_000_000 for name in names)
    most = max(sum(0 <= other - at < 250_000_000 for other in sent_ns) for at in sent_ns)
    assert len(names) == 11
    assert most <= 5, sent_ns


def test_a_procedure_is_answered_while_the_train_runs(together: tuple[Stack, Outside]) -> None:
    _, outside = together
    replies = list(outside.session.get(rpc_key("regional-1", "latest_feedback"), timeout=5.0))
    names = {str(reply.ok.key_expr).rpartition("/")[2] for reply in replies}
    assert names == {"fuser", "filter-odometer-front", "filter-odometer-rear", "filter-radar"}
    assert all(decode(reply.ok.payload.to_bytes(), Feedback).train == "regional-1" for reply in replies)


def test_an_injected_fault_excludes_the_unit_and_its_end_readmits_it(together: tuple[Stack, Outside]) -> None:
    stack, outside = together
    done = milepost("inject", "radar", "bias", "--size", "3", "--connect", stack.endpoint)
    assert done.returncode == 0, done.stderr
    outside.wait_state(f"{TOP}/state", lambda m: "radar" in [e["unit"] for e in m["excluded"]], 20.0, "an excluded radar")
    done = milepost("inject", "radar", "--clear", "--connect", stack.endpoint)
    assert done.returncode == 0, done.stderr
    outside.wait_state(f"{TOP}/state", lambda m: m["status"] == "normal", 40.0, "a normal state again")


def settled(folder: Path, origin: str) -> list[dict]:
    """What a recording settles to, without what tells one run's time from another's."""
    (recording,) = recordings_in(folder)
    out = folder / f"{origin}.jsonl"
    done = milepost("rerun", recording, "--train", "metro", "--from", origin, "--out", out)
    assert done.returncode == 0, done.stderr
    states = [json.loads(line) for line in out.read_text(encoding="utf-8").splitlines()]
    return [{key: value for key, value in state.items() if key not in EPOCH_FIELDS} for state in states]


def test_a_train_settles_to_the_bits_of_separate_processes(tmp_path: Path) -> None:
    """GIVEN the same scenario live, together and apart, THEN all that was recorded, read or estimated, settles to the same."""
    found = {}
    for mode in ("--together", "--headless"):
        folder = tmp_path / mode
        command = ["up", "--headless", "--train", "metro", "--duration", DURATION_S, "--record", folder, mode]
        done = milepost(*command, "--listen", f"tcp/127.0.0.1:{free_port()}")
        assert done.returncode == 0, done.stderr
        senders = Summary().read(recordings_in(folder)).senders
        assert not {sender: run.gaps for sender, run in senders.items() if run.missing}
        found[mode] = [settled(folder, origin) for origin in ("readings", "estimates")]
    assert len(found["--together"][0]) >= 10 * DURATION_S - 2
    assert found["--together"] == found["--headless"]
    assert found["--together"][0] == found["--together"][1]


# `milepost up` with a bug in a filter, that shows once a file is there
WITH_A_BUG = """
import pathlib, sys
from milepost.nodes.filter import FilterNode
mark, step = pathlib.Path(sys.argv.pop(1)), FilterNode.step
def failing(self, message, now_ns):
    if self.unit == "radar" and mark.exists():
        mark.unlink()
        raise ZeroDivisionError("a bug")
    return step(self, message, now_ns)
FilterNode.step = failing
from milepost.cli.entry import main
main()
"""


def test_a_node_that_raises_ends_the_process_and_says_so_and_it_is_restarted(tmp_path: Path) -> None:
    """WHEN one node of a train raises, THEN an event names it, the process ends, all tokens go, and all is started again."""
    endpoint, top, mark = f"tcp/127.0.0.1:{free_port()}", "milepost/v1/maglev-1", tmp_path / "mark"
    command = ["up", "--headless", "--together", "--train", "maglev", "--listen", endpoint]
    program = [sys.executable, "-c", WITH_A_BUG, str(mark), *command]
    with subprocess.Popen(program, stderr=subprocess.PIPE, text=True) as up:
        outside = Outside(endpoint)
        try:
            outside.listen(f"{top}/event")
            outside.listen(f"{top}/state")
            outside.watch_tokens(f"{top}/alive/**")

            def failures() -> list[dict]:
                return [event for event in outside.messages(f"{top}/event") if event["code"] == "process_failed"]

            outside.wait_state(f"{top}/state", lambda m: m["status"] == "normal", 40.0, "a normal state")
            mark.touch()
            outside.wait_for(failures, 20.0, "an event that says so")
            assert [event["text"] for event in failures()] == ["filter-radar ends: ZeroDivisionError: a bug"]
            before = set(outside.tokens)
            outside.wait_for(lambda: not any(outside.tokens[key] for key in before), 10.0, "all tokens gone")
            outside.wait_for(lambda: sum(outside.tokens.values()) == 8, 30.0, "all processes back")
            outside.wait_state(f"{top}/state", lambda m: m["status"] == "normal", 30.0, "a normal state again")
        finally:
            outside.close()
            up.send_signal(signal.SIGINT)
            _, said = up.communicate(timeout=20.0)
    assert up.returncode == 0
    assert "milepost: together ended with exit code 1" in said
    assert "milepost: together restarted" in said


def test_trains_of_a_fleet_share_processes_and_a_recorder(tmp_path: Path) -> None:
    """GIVEN five trains and fewer cores, THEN there are as many processes as cores; each is recorded in a file of its own.

    Another train at the same router is not recorded.
    """
    fleet, folder = tmp_path / "five.yaml", tmp_path / "recording"
    entry = {"train": "maglev", "name": "shuttle", "count": 5, "change": {"fusion": {"period_ms": 100, "deadline_ms": 60.0}}}
    fleet.write_text(yaml.safe_dump({"fleet": "five", "trains": [entry]}), encoding="utf-8")
    names = [f"shuttle-{n}" for n in range(1, 6)]
    stack = Stack("", "--fleet", str(fleet), "--together", "--record", str(folder))
    outside = Outside(stack.endpoint)
    outside.listen("milepost/v1/*/state")
    strange = EXAMPLES["state"][0]
    try:
        for name in names:
            outside.session.put(f"milepost/v1/{strange.train}/state", encode(strange), encoding=strange.encoding())
            outside.wait_state(f"milepost/v1/{name}/state", lambda m: m["status"] == "normal", 60.0, f"a normal {name}")
        titles = [" ".join(child.cmdline()) for child in psutil.Process(stack.process.pid).children()]
        assert sum("run together" in title for title in titles) == min(5, len(os.sched_getaffinity(0)))
        assert sum("run recorder" in title for title in titles) == 1
        # the worlds differ
        assert len({outside.newest(f"milepost/v1/{name}/state")["speed_mps"] for name in names}) == 5
        begun = time.monotonic()
        stack.process.send_signal(signal.SIGINT)
        assert stack.process.wait(10.0) == 0, "".join(stack.errors)
        assert time.monotonic() - begun < 5.0
    finally:
        outside.close()
        stack.stop()
    assert not [line for line in stack.errors if "did not end" in line or "Traceback" in line]
    assert outside.newest(f"milepost/v1/{strange.train}/state")
    summary = Summary().read(recordings_in(folder))
    assert sorted(path.name.rpartition("-2")[0].partition("-2026")[0] for path in folder.iterdir()) == names
    assert {sender.train for sender in summary.senders} == set(names)
