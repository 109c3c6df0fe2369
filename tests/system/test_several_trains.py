"""Several trains on one router: from one command, and joined by another one."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import psutil
import pytest
import yaml

from conftest import Outside, Stack, title_of

FLEET = "deploy/fleets/three-trains.yaml"
NAMES = ["airport-1", "metro-1", "metro-2"]
TOP = "milepost/v1"


def milepost(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "milepost", *words], capture_output=True, text=True, timeout=60, check=False)


def normal(outside: Outside, name: str) -> None:
    outside.wait_state(f"{TOP}/{name}/state", lambda m: m["status"] == "normal", 40.0, f"a normal state of {name}")


@pytest.fixture(scope="module")
def fleet() -> Iterator[tuple[Stack, Outside]]:
    """The shipped fleet from one command, and a session that knows nothing of Milepost."""
    stack = Stack("", "--fleet", FLEET)
    outside = Outside(stack.endpoint)
    outside.listen(f"{TOP}/**")
    outside.watch_tokens(f"{TOP}/*/alive/**")
    try:
        for name in NAMES:
            normal(outside, name)
        yield stack, outside
    finally:
        outside.close()
        code = stack.stop()
    assert code == 0, "".join(stack.errors)


def joining(folder: Path, **changed: object) -> Path:
    path = folder / "joining.yaml"
    path.write_text(yaml.safe_dump({"fleet": "joining", "trains": [{"train": "maglev", **changed}]}), encoding="utf-8")
    return path


def test_a_plain_subscriber_sees_every_train_and_status_lists_them_sorted(fleet: tuple[Stack, Outside]) -> None:
    stack, outside = fleet
    speaking = {m["train"] for key, heard in outside.heard.items() if key.endswith("/state") for _, m in heard}
    assert speaking == set(NAMES)
    done = milepost("status", "--json", "--connect", stack.endpoint)
    assert done.returncode == 0, done.stderr
    listed = json.loads(done.stdout)
    assert [row["train"] for row in listed] == NAMES
    assert [row["line"] for row in listed] == ["airport-maglev", "metro", "metro"]
    lines = milepost("status", "--connect", stack.endpoint).stdout.splitlines()
    assert [line.partition(":")[0] for line in lines] == NAMES


def test_status_names_a_train_that_runs_and_says_nothing(fleet: tuple[Stack, Outside]) -> None:
    """WHEN a train's fuser hangs THEN status does not pass it over."""
    stack, outside = fleet
    (pid,) = [c.pid for c in psutil.Process(stack.process.pid).children() if title_of(c.pid) == "milepost run fuser (metro-2)"]
    os.kill(pid, signal.SIGSTOP)
    try:
        listed = milepost("status", "--json", "--connect", stack.endpoint)
        lines = milepost("status", "--connect", stack.endpoint)
    finally:
        os.kill(pid, signal.SIGCONT)
    assert (listed.returncode, lines.returncode) == (1, 1)
    rows = json.loads(listed.stdout)
    assert [row["train"] for row in rows] == NAMES
    assert [row["status"] == "silent" for row in rows] == [False, False, True]
    assert lines.stdout.splitlines()[-1] == "metro-2: silent: no state within 2 s"
    normal(outside, "metro-2")


def test_the_trains_of_a_fleet_start_in_their_time(fleet: tuple[Stack, Outside]) -> None:
    stack, _ = fleet
    said = [line for line in stack.errors if re.search("first state after|starting [a-z]", line)]
    order = [re.sub(r".*milepost: (starting )?", "", line).split(":")[0].strip() for line in said]
    assert order == ["metro-1", "airport-1", "airport-1", "metro-2", "metro-2"]


def test_a_process_that_dies_is_named_with_its_train_and_restarted(fleet: tuple[Stack, Outside]) -> None:
    stack, outside = fleet
    title = "milepost run filter radar-1 (metro-2)"
    (pid,) = [child.pid for child in psutil.Process(stack.process.pid).children() if title_of(child.pid) == title]
    tokens = {key for key, there in outside.tokens.items() if there and "/metro-2/alive/filter-radar-1/" in key}
    os.kill(pid, signal.SIGKILL)

    def successor() -> bool:
        now = {key for key, there in outside.tokens.items() if there and "/metro-2/alive/filter-radar-1/" in key}
        return bool(now - tokens)

    outside.wait_for(successor, 10.0, "another filter")
    assert any("metro-2 filter-radar-1 ended with signal SIGKILL" in line for line in stack.errors)
    normal(outside, "metro-2")


def test_a_second_train_of_a_name_may_not_join(fleet: tuple[Stack, Outside], tmp_path: Path) -> None:
    """WHEN a train whose name is taken is to join, THEN that is one line and exit code 2, and nothing of it has run."""
    stack, outside = fleet
    path = joining(tmp_path, name="metro-2")
    before = sum(outside.tokens.values())
    done = milepost("up", "--headless", "--fleet", str(path), "--connect", stack.endpoint)
    said = f"milepost: up: --connect: metro-2 is running at {stack.endpoint} already (12 processes); names must differ"
    assert (done.returncode, done.stderr.splitlines()) == (2, [f"milepost: reading {path}", said])
    assert sum(outside.tokens.values()) == before


def test_a_train_joins_a_router_and_leaves_it_without_touching_the_others(fleet: tuple[Stack, Outside], tmp_path: Path) -> None:
    stack, outside = fleet
    path, report = joining(tmp_path, name="guest-1"), tmp_path / "report.json"
    options = ["--connect", stack.endpoint, "--duration", "3", "--report", str(report), "--record", str(tmp_path / "recording")]
    done = milepost("up", "--headless", "--fleet", str(path), *options)
    assert done.returncode == 0, done.stderr
    assert "absent" not in done.stderr, "the end of a scenario is no failure"
    found = json.loads(report.read_text(encoding="utf-8"))
    # the report is of this train alone, which runs for 150 epochs and a little, and whoever listens on the router sees it
    assert 0 < found["states"] < 2 * 150
    assert 0 < len(outside.heard[f"{TOP}/guest-1/state"]) < 2 * 150
    assert found["truth"]["outside_interval"] == 0
    assert [path.name.partition("-2")[0] for path in (tmp_path / "recording").iterdir()] == ["guest-1"]
    for name in NAMES:
        normal(outside, name)
    assert not [e for name in NAMES for e in outside.messages(f"{TOP}/{name}/event") if e["code"] == "second_instance"]
