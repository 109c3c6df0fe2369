"""A train of one's own in containers, in a folder of one's own: `milepost compose`, with recorder, feed and dispatch page."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
import zenoh
from containers import Stack, tell
from engine import ROOT, find_compose, free_port, wait_until_healthy

from milepost.config.roles import processes
from milepost.config.train import load_train
from milepost.runtime import zenoh_config

pytestmark = pytest.mark.compose
websockets = pytest.importorskip("websockets.sync.client", reason="no websockets: pip install 'milepost[page]'")
OWN = "milepost/v1/own-1"
NAMES = {"recorder", "feed", "page", "router", "router-2"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a train file, its line file and the compose file that was printed there."""
    folder = tmp_path_factory.mktemp("own")
    train = yaml.safe_load((ROOT / "deploy/trains/regional.yaml").read_text(encoding="utf-8"))
    train |= {"train": "own-1", "line": "line.yaml"}
    (folder / "mine.yaml").write_text(yaml.safe_dump(train, sort_keys=False), encoding="utf-8")
    shutil.copy(ROOT / "deploy/lines/regional.yaml", folder / "line.yaml")
    words = ["compose", "mine.yaml", "--record", "--feed", "--page"]
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "services"), str(ROOT / "schemas")])}
    with (folder / "compose.yaml").open("w", encoding="utf-8") as file:
        subprocess.run(
            [sys.executable, "-m", "milepost", *words], cwd=folder, env=environment, stdout=file, check=True, timeout=60
        )
    return folder


@pytest.fixture(scope="module")
def stack(request: pytest.FixtureRequest, folder: Path) -> Iterator[Stack]:
    tool, project = find_compose(), f"milepost-own-{os.getpid()}"
    ports = {f"MILEPOST_{name}": str(free_port()) for name in ("PORT", "PORT_2", "FEED_PORT", "PAGE_PORT")}
    stack = Stack([*tool, "-f", str(folder / "compose.yaml"), "-p", project], project, {**os.environ, **ports})
    config = zenoh_config.tool([f"tcp/127.0.0.1:{ports['MILEPOST_PORT']}"], 30000)
    try:
        stack.call("config", "-q")
        stack.call("build", timeout_s=900.0)
        begun = time.monotonic()
        stack.call("up", "-d")
        with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
            kept = session.declare_subscriber(f"{OWN}/state", stack.listener.on_state)
            stack.listener.wait(lambda: bool(stack.listener.states), 90.0, "a first state")
            stack.figures["first state of the own train after s"] = time.monotonic() - begun
            yield stack
            del kept
    finally:
        tell(request, stack)
        stack.call("down", "--volumes", "--remove-orphans", "--timeout", "5")


def address(stack: Stack, name: str) -> str:
    return f"http://127.0.0.1:{stack.environment[f'MILEPOST_{name.upper()}_PORT']}"


def get(url: str, within_s: float = 60.0) -> tuple[int, str]:
    """Status and content, as soon as somebody answers."""
    deadline = time.monotonic() + within_s
    while True:
        try:
            with urllib.request.urlopen(url, timeout=10.0) as answer:
                return answer.status, answer.read().decode()
        except (urllib.error.URLError, ConnectionError):
            assert time.monotonic() < deadline, f"nobody answers at {url}"
            time.sleep(0.2)  # between two looks; the engine tells nobody when a server listens


def records(stack: Stack, service: str) -> list[dict[str, Any]]:
    command = ["docker", "logs", stack.container(service)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=30.0)
    return [json.loads(line) for line in (done.stdout + done.stderr).splitlines()]


def test_each_process_of_the_own_train_is_a_container_that_becomes_healthy(stack: Stack, folder: Path) -> None:
    """GIVEN a train of one's own, THEN its processes, and what was asked for beside them, run in containers."""
    names = NAMES | {process.name for process in processes(load_train(folder / "mine.yaml"), live=True)}
    assert set(yaml.safe_load((folder / "compose.yaml").read_text(encoding="utf-8"))["services"]) == names
    wait_until_healthy({name: stack.container(name) for name in sorted(names)}, 120.0)
    state = stack.listener.wait_for_state(lambda state: state["status"] == "normal", 60.0, "a normal state")
    assert stack.listener.states[state][1]["train"] == "own-1"
    assert {name: stack.inspect(name)["RestartCount"] for name in names} == dict.fromkeys(names, 0)


def test_the_page_is_served_at_the_address_that_its_log_says(stack: Stack) -> None:
    """GIVEN the page's container, WHEN the address in its log is opened on this machine, THEN it shows the train as it runs."""
    page = address(stack, "page")
    assert get(page)[0] == 200
    (said,) = [each for each in records(stack, "page") if "dispatch page" in each["message"]]
    assert said["message"] == f"the dispatch page is at {page}"
    status, content = get(f"{page}/train/own-1")
    assert (status, "own-1" in content) == (200, True)
    with websockets.connect(f"{page.replace('http', 'ws')}/live", proxy=None) as socket:
        socket.send("")
        frame = socket.recv(timeout=30.0)
    assert '"own-1"' in frame, frame[:500]
    assert "no geometry" not in str(records(stack, "page")), "the line of the train was not found"


def test_the_feed_has_the_train(stack: Stack) -> None:
    status, content = get(f"{address(stack, 'feed')}/metrics")
    assert status == 200
    assert 'train="own-1"' in content


def test_the_recorder_writes_to_its_volume(stack: Stack) -> None:
    assert ".mcap" in stack.inside("recorder", "ls /var/lib/milepost/recordings")


@pytest.mark.parametrize("name", ["router", "fuser", "page", "world"])
def test_what_a_container_says_is_json(stack: Stack, name: str) -> None:
    found = records(stack, name)
    assert name not in ("router", "page") or found, "it says where it listens"
    for each in found:
        assert {"time", "level", "process", "message"} <= set(each)
        assert each["process"] == name


def test_containers_have_the_files_of_the_train_read_only(stack: Stack) -> None:
    """GIVEN the folder of the train, THEN a container has its files and nothing else of it, and writes none."""
    listed = stack.inside("filter-radar", "ls /srv/milepost").split()
    assert listed == ["line.yaml", "mine.yaml"]
    assert "OK" not in stack.inside("filter-radar", "touch /srv/milepost/mine.yaml 2>/dev/null && echo OK || true")
