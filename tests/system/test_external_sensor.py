"""docs/external-sensors.md followed to the letter: a program that imports nothing of Milepost is a sensor of a train."""

from __future__ import annotations

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from conftest import Outside, Stack, start

GUIDE = Path("docs/external-sensors.md").read_text(encoding="utf-8")
PROGRAM, CLOCK = re.findall(r"```python\n(.*?)```", GUIDE, re.S)
(ENTRY,) = re.findall(r"```yaml\n(.*?)```", GUIDE, re.S)
TOP = "milepost/v1/metro-1"


def program(endpoint: str) -> subprocess.Popen[str]:
    text = PROGRAM.replace("tcp/127.0.0.1:7447", endpoint)
    return subprocess.Popen([sys.executable, "-c", text], stderr=subprocess.PIPE, text=True)


@pytest.fixture(scope="module")
def train(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Stack, Outside]]:
    """The metro train with the guide's unit, and without a process for its sensor."""
    deployed = Path("deploy/trains/metro.yaml").resolve()
    text = deployed.read_text(encoding="utf-8") + ENTRY
    text = text.replace("../lines", str(deployed.parent.parent / "lines"))
    path = tmp_path_factory.mktemp("trains") / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    assert "my-radar" in yaml.safe_load(text)["units"]
    stack, outside = start(str(path), "--external", "my-radar")
    try:
        yield stack, outside
    finally:
        outside.close()
        code = stack.stop()
    assert code == 0, "".join(stack.errors)


@pytest.fixture(scope="module")
def sensor(train: tuple[Stack, Outside]) -> Iterator[subprocess.Popen[str]]:
    process = program(train[0].endpoint)
    yield process
    process.kill()
    process.communicate(timeout=10.0)


def in_use(state: dict) -> bool:
    return "my-radar" in {sensor["unit"] for sensor in state["sensors"]}


def test_the_program_is_short_and_imports_nothing_of_milepost() -> None:
    imported = {alias.name for node in ast.walk(ast.parse(PROGRAM)) if isinstance(node, ast.Import) for alias in node.names}
    assert imported == {"random", "time", "uuid", "msgpack", "zenoh"}
    assert len(PROGRAM.strip().splitlines()) <= 30
    assert "milepost" not in PROGRAM.replace("milepost/v1", "")


def test_the_unit_is_used_by_the_fuser_and_nothing_is_refused(
    train: tuple[Stack, Outside], sensor: subprocess.Popen[str]
) -> None:
    """GIVEN a train that waits for the program, WHEN it runs, THEN the train begins, and the unit counts like the others."""
    _, outside = train
    accept = lambda m: m["status"] == "normal" and in_use(m)  # noqa: E731
    state = outside.wait_state(f"{TOP}/state", accept, 40.0, "a normal state with my-radar in use")
    (used,) = (each for each in state["sensors"] if each["unit"] == "my-radar")
    assert used["share"] > 0.0
    health = f"{TOP}/health/filter-my-radar"
    outside.wait_for(lambda: outside.newest(health).get("uptime_s", 0.0) > 4.0, 15.0, "the filter's health after some seconds")
    found = outside.newest(health)
    assert found["refused"] == {}
    assert found["gaps"] == 0
    assert found["received_hz"]["speed_reading"] == pytest.approx(10.0, abs=2.0)
    assert sensor.poll() is None
    assert not [e for e in outside.messages(f"{TOP}/event") if "my-radar" in e["text"] and e["severity"] != "info"]


def test_the_clock_of_the_guide_is_that_of_the_train(train: tuple[Stack, Outside], sensor: subprocess.Popen[str]) -> None:
    _, outside = train
    outside.wait_state(f"{TOP}/state", in_use, 40.0, "my-radar in use")
    names: dict = {}
    exec(CLOCK, names)
    now_ns = names["scenario_clock"](outside.session, "metro-1")
    state = outside.wait_state(f"{TOP}/state", lambda m: True, 5.0, "a state")
    assert abs(now_ns() - state["measured_at_ns"]) < 0.3e9


def test_a_program_that_ends_is_noticed_and_one_that_is_started_again_is_used(
    train: tuple[Stack, Outside], sensor: subprocess.Popen[str]
) -> None:
    stack, outside = train
    outside.wait_state(f"{TOP}/state", in_use, 40.0, "my-radar in use")
    sensor.kill()

    def absent(state: dict) -> bool:
        return any(entry["unit"] == "my-radar" and entry["kind"] == "absent" for entry in state["excluded"])

    outside.wait_state(f"{TOP}/state", absent, 10.0, "my-radar absent")
    second = program(stack.endpoint)
    try:
        outside.wait_state(f"{TOP}/state", in_use, 15.0, "my-radar in use again")
    finally:
        second.kill()
        second.communicate(timeout=10.0)
