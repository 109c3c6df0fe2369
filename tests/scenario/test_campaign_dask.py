"""The same campaign on a Dask cluster of real processes, one of which is killed on the way."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from harness import ROOT
from test_campaign import BRIEF, TINY, campaign, command, written

pytestmark = pytest.mark.long

pytest.importorskip("distributed")


def start(module: str, *arguments: object) -> subprocess.Popen[str]:
    line = [sys.executable, "-m", f"distributed.cli.{module}", "--no-dashboard", *map(str, arguments)]
    return subprocess.Popen(line, cwd=ROOT, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def worker(address: str, folder: Path) -> subprocess.Popen[str]:
    options = ("--no-nanny", "--nthreads", 1, "--host", "127.0.0.1", "--local-directory", folder)
    return start("dask_worker", address, *options)


@pytest.fixture
def started(tmp_path: Path) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """A scheduler: its address, which its own file says, and its process."""
    file = tmp_path / "scheduler.json"
    running = start("dask_scheduler", "--host", "127.0.0.1", "--port", 0, "--scheduler-file", file)
    try:
        while not file.exists() or not file.read_text(encoding="utf-8").rstrip().endswith("}"):
            with pytest.raises(subprocess.TimeoutExpired):
                running.wait(timeout=0.05)
        yield json.loads(file.read_text(encoding="utf-8"))["address"], running
    finally:
        running.kill()
        running.communicate()


@pytest.fixture
def scheduler(started: tuple[str, subprocess.Popen[str]]) -> str:
    return started[0]


def wait_for_runs(kept: Path, running: subprocess.Popen[str]) -> None:
    """Wait until two runs are in the file of results."""
    while not kept.exists() or kept.read_bytes().count(b"\n") < 2:
        with pytest.raises(subprocess.TimeoutExpired):
            running.wait(timeout=0.05)


def test_a_cluster_that_loses_a_worker_gives_the_local_figures(tmp_path: Path, scheduler: str) -> None:
    path, kept = written(tmp_path, runs=10, trains=BRIEF), tmp_path / "runs.jsonl"
    workers = [worker(scheduler, tmp_path) for _ in range(2)]
    line = command(path, "--json", "--dask", scheduler, "--resume", kept)
    running = subprocess.Popen(line, cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    try:
        wait_for_runs(kept, running)
        workers[0].kill()
        finished = kept.read_bytes().count(b"\n")
        said, errors = running.communicate(timeout=120)
    finally:
        for process in (running, *workers):
            process.kill()
            process.communicate()
    assert finished < 20
    assert errors == ""
    local = campaign(path, "--json", "--jobs", 2)
    assert running.returncode == local.returncode
    assert said == local.stdout


def test_a_scheduler_that_dies_is_one_line(tmp_path: Path, started: tuple[str, subprocess.Popen[str]]) -> None:
    address, scheduling = started
    path, kept = written(tmp_path, runs=100), tmp_path / "runs.jsonl"
    working = worker(address, tmp_path)
    running = subprocess.Popen(command(path, "--dask", address, "--resume", kept), cwd=ROOT, stderr=subprocess.PIPE, text=True)
    try:
        wait_for_runs(kept, running)
        scheduling.kill()
        _, errors = running.communicate(timeout=60)
    finally:
        for process in (running, working):
            process.kill()
            process.communicate()
    assert running.returncode == 2
    assert errors == f"milepost: campaign: --dask: the scheduler at {address} has gone\n"


def test_a_cluster_that_cannot_be_used_is_one_line(tmp_path: Path, scheduler: str) -> None:
    path = written(tmp_path)
    for address, said in (
        (scheduler, "has no workers"),
        ("tcp://127.0.0.1:1", "no scheduler at"),
        ("nonsense://x", "must be like tcp://HOST:PORT"),
    ):
        done = campaign(path, "--dask", address)
        assert (done.returncode, done.stdout) == (2, "")
        assert len(done.stderr.splitlines()) == 1, done.stderr
        assert said in done.stderr


def test_where_dask_is_absent_the_option_says_what_to_install(tmp_path: Path) -> None:
    path = tmp_path / "tiny.yaml"
    path.write_text(json.dumps(TINY), encoding="utf-8")
    # a finder that knows no `distributed` stands for an environment without it
    code = (
        "import sys, importlib.util as u; found = u.find_spec;"
        "u.find_spec = lambda name, *more: None if name == 'distributed' else found(name, *more);"
        f"sys.argv = ['milepost', 'campaign', {str(path)!r}, '--dask', 'tcp://127.0.0.1:1'];"
        "from milepost.cli.main import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert done.stderr == "milepost: campaign: --dask: needs dask.distributed: pip install 'milepost[dask]'\n"
