"""deploy/dask-compose.yaml brought up for real: a campaign that the host gives to the workers in containers."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from engine import ROOT, find_compose, free_port, run

distributed = pytest.importorskip("distributed")

# the engine's image may have another patch version of Python
pytestmark = [pytest.mark.compose, pytest.mark.filterwarnings("ignore:Mismatched versions")]

RECORDINGS = (ROOT / "../shared/data").resolve()
WITHIN_S = 60.0
SHORT: dict[str, Any] = {
    "campaign": "short",
    "about": "A radar or the GNSS lies.",
    "runs": 2,
    "trains": {"maglev": {"train": "maglev", "duration_s": 4.0, "onset_s": 2.0}},
    "faults": [{"label": "bias +5 m/s", "kind": "bias", "options": {"size": 5.0}, "trains": ["maglev"]}],
}
if RECORDINGS.is_dir():
    # a recording, which the workers find where the containers have it
    SHORT["trains"]["brussels"] = {"train": "brussels-28876", "duration_s": 4.0, "onset_s": 2.0}
    SHORT["faults"].append({"label": "jump 50 m", "kind": "jump", "options": {"size": 50.0}})


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The scheduler's address, from the host, of a cluster that is up."""
    port = free_port()
    recordings = RECORDINGS if RECORDINGS.is_dir() else tmp_path_factory.mktemp("none")
    environment = {**os.environ, "MILEPOST_DASK_PORT": str(port), "MILEPOST_RECORDINGS": str(recordings)}
    compose = [*find_compose(), "-f", str(ROOT / "deploy/dask-compose.yaml"), "-p", f"milepost-dask-{os.getpid()}"]
    try:
        run([*compose, "build"], 900.0, environment)
        run([*compose, "up", "-d"], WITHIN_S, environment)
        yield f"tcp://127.0.0.1:{port}"
    finally:
        run([*compose, "down", "--volumes", "--timeout", "5"], WITHIN_S, environment)


@pytest.fixture(scope="module")
def campaign_file(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("campaign") / "short.yaml"
    path.write_text(json.dumps(SHORT), encoding="utf-8")
    return path


def campaign(*arguments: object) -> subprocess.CompletedProcess[str]:
    line = [sys.executable, "-m", "milepost", "campaign", *map(str, arguments)]
    return subprocess.run(line, cwd=ROOT, capture_output=True, text=True, timeout=WITHIN_S, check=False)


def test_containers_give_the_figures_of_this_machine(address: str, campaign_file: Path) -> None:
    with distributed.Client(address, timeout=WITHIN_S, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=WITHIN_S)
        client.get_task_stream()  # from now on the scheduler keeps who ran what
        there = campaign(campaign_file, "--json", "--dask", address)
        workers = {entry["worker"] for entry in client.get_task_stream()}
    assert there.stderr == ""
    assert len(workers) == 2
    here = campaign(campaign_file, "--json", "--jobs", 2)
    assert there.returncode == here.returncode
    assert there.stdout == here.stdout
    assert {cell["train"] for cell in json.loads(here.stdout)["cells"]} == set(SHORT["trains"])


def test_a_train_file_that_the_workers_lack_is_one_line(address: str, tmp_path: Path) -> None:
    train = tmp_path / "own.yaml"
    text = (ROOT / "deploy/trains/maglev.yaml").read_text(encoding="utf-8")
    train.write_text(text.replace("../lines", str(ROOT / "deploy/lines")), encoding="utf-8")
    path = tmp_path / "own-campaign.yaml"
    trains = {"own": {**SHORT["trains"]["maglev"], "train": str(train)}}
    path.write_text(json.dumps({**SHORT, "trains": trains, "faults": []}), encoding="utf-8")
    done = campaign(path, "--dask", address)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"milepost: {train}: a worker has no such file\n"
