"""compose.yaml is what `milepost compose full` prints: the train's processes, each under its own name, and nothing else."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

from milepost.cli.composing.compose import Beside, compose
from milepost.cli.options import DEFAULT_TRAIN
from milepost.config.errors import ConfigError
from milepost.config.roles import Process, processes
from milepost.config.shipped_files import find_file, names_in
from milepost.config.train import load_train

ROOT = Path(__file__).parents[2]
SERVICES: dict[str, dict[str, Any]] = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))["services"]
TRAIN = load_train(find_file(DEFAULT_TRAIN, "trains"))
PROCESSES = processes(TRAIN, live=True)
KEEPS = {f"filter-{unit}" for unit, sensor in TRAIN.sensors.items() if sensor.kind == "odometer"}
LEARNED = "${MILEPOST_STATE:-learned}:/var/lib/milepost"
FILES = {"trains/full.yaml", "lines/airport-maglev.yaml", "lines/airport-maglev.geojson"}


def test_the_file_is_byte_for_byte_what_the_command_prints() -> None:
    """GIVEN the repository, WHEN `milepost compose full` is run in it, THEN it prints compose.yaml."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT / "services"), str(ROOT / "schemas")])}
    command = [sys.executable, "-m", "milepost", "compose", "full"]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, check=False, timeout=60)
    assert (done.returncode, done.stderr) == (0, b"")
    assert done.stdout == (ROOT / "compose.yaml").read_bytes(), "milepost compose full > compose.yaml"


@pytest.mark.parametrize("name", names_in("trains"))
@pytest.mark.parametrize("beside", [Beside(), Beside(record=True, feed=True, page=True)], ids=["alone", "all"])
def test_every_process_of_a_shipped_train_is_a_service_once(name: str, beside: Beside, monkeypatch: pytest.MonkeyPatch) -> None:
    """GIVEN a shipped train, WHEN its compose file is printed, THEN it has routers, its processes and what was asked for."""
    monkeypatch.chdir(ROOT)
    path = find_file(Path(name), "trains")
    try:
        text, _ = compose(path, name, beside)
    except ConfigError as error:
        if "shared/data" in str(error) and "such file" in str(error):
            pytest.skip(f"needs recorded data: {error}")
        raise
    train = load_train(path)
    # a service that is there twice would be one in the parsed file
    written = re.findall(r"^  ([\w.-]+):$", text.split("\nservices:\n")[1].split("\nvolumes:\n")[0], re.M)
    asked = [each.removeprefix("--").replace("record", "recorder") for each in beside.options]
    assert sorted(written) == sorted(["router", "router-2", *asked, *(each.name for each in processes(train, live=True))])
    services = yaml.safe_load(text)["services"]
    for each in processes(train, live=True):
        unit = [] if each.unit == each.role else [each.unit]
        assert services[each.name]["command"][: 2 + len(unit)] == ["run", each.role, *unit]
    assert not re.search(r"<[a-z_]+>", text), "a part of the skeleton was left empty"


def test_there_is_a_container_for_each_process_and_router() -> None:
    assert sorted(SERVICES) == sorted(["router", "router-2", *(process.name for process in PROCESSES)])


@pytest.mark.parametrize("process", PROCESSES, ids=lambda process: process.name)
def test_each_container_runs_its_process(process: Process) -> None:
    unit = [] if process.unit == process.role else [process.unit]
    command = SERVICES[process.name]["command"]
    kept = ["--state-dir", "/var/lib/milepost"] if process.name in KEEPS else []
    assert command == ["run", process.role, *unit, *kept]


def test_router_takes_the_file_that_zenohd_takes() -> None:
    command = SERVICES["router"]["command"]
    assert command == ["run", "router", "--config", "deploy/zenoh/router.json5"]
    assert (ROOT / command[-1]).is_file()


def test_the_second_router_is_linked_with_the_first() -> None:
    command = SERVICES["router-2"]["command"]
    assert command == ["run", "router", "router-2", "--listen", "tcp/0.0.0.0:7447", "--link", "tcp/router:7447"]


@pytest.mark.parametrize("name", SERVICES)
def test_a_crashed_process_is_restarted(name: str) -> None:
    assert SERVICES[name]["restart"] == "on-failure"


@pytest.mark.parametrize("name", SERVICES)
def test_every_container_runs_with_the_least_privileges(name: str) -> None:
    service = SERVICES[name]
    assert service["read_only"] is True
    assert service["tmpfs"] == ["/tmp"]
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert "user" not in service, "the image's user is the right one"
    assert not {"privileged", "cap_add", "network_mode", "pid"} & set(service)
    # what a filter learned outlives it; nothing else does. Routers read no file of the train
    files = [each for each in service.get("volumes", []) if isinstance(each, dict)]
    assert {each["target"].removeprefix("/srv/milepost/") for each in files} == (set() if name.startswith("router") else FILES)
    assert all(each["type"] == "bind" and each["read_only"] is True for each in files)
    assert all((ROOT / each["source"]).is_file() for each in files), "a folder may hold what no process is to read"
    assert [each for each in service.get("volumes", []) if each not in files] == ([LEARNED] if name in KEEPS else [])


@pytest.mark.parametrize("name", SERVICES)
def test_every_container_has_a_cheap_healthcheck(name: str) -> None:
    check = SERVICES[name]["healthcheck"]
    assert check["test"][0] in ("CMD", "CMD-SHELL")
    assert int(check["interval"].removesuffix("s")) >= 10, "two cores run the train as well"


def test_one_image_is_built_once() -> None:
    assert len({service["image"] for service in SERVICES.values()}) == 1
    assert [name for name, service in SERVICES.items() if "build" in service] == ["router"]


def test_only_the_routers_are_reachable_and_only_from_this_machine() -> None:
    assert [name for name, service in SERVICES.items() if "ports" in service] == ["router", "router-2"]
    assert SERVICES["router"]["ports"] == ["127.0.0.1:${MILEPOST_PORT:-7447}:7447"]
    assert SERVICES["router-2"]["ports"] == ["127.0.0.1:${MILEPOST_PORT_2:-7448}:7447"]
    assert {service["environment"]["MILEPOST_CONNECT"] for service in SERVICES.values()} == {
        "tcp/router:7447 tcp/router-2:7447"
    }
