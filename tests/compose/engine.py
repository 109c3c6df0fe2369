"""The container engine and its compose tool, as a person calls them."""

from __future__ import annotations

import shutil
import socket
import subprocess
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def find_compose() -> list[str]:
    """The compose tool, of either generation; skips where there is none, or no engine."""
    if shutil.which("docker") is None or subprocess.run(["docker", "info"], capture_output=True, check=False).returncode:
        pytest.skip("no container engine: `docker info` does not answer")
    for tool in (["docker", "compose"], ["docker-compose"]):
        if shutil.which(tool[0]) and not subprocess.run([*tool, "version"], capture_output=True, check=False).returncode:
            return tool
    pytest.skip("no compose tool: neither `docker compose` nor `docker-compose` answers")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def run(command: list[str], timeout_s: float, environment: dict[str, str] | None = None) -> str:
    done = subprocess.run(
        command,
        cwd=ROOT,
        env=environment,
        timeout=timeout_s,
        text=True,
        capture_output=True,
        check=False,
    )
    if done.returncode:
        pytest.fail(f"{' '.join(command)}: exit code {done.returncode}\n{done.stdout}\n{done.stderr}", pytrace=False)
    return done.stdout


def wait_until_healthy(waiting: dict[str, str], within_s: float) -> None:
    """Wait until all of these containers, by service, are healthy."""
    deadline = time.monotonic() + within_s
    while waiting:
        said = run(["docker", "inspect", "-f", "{{.State.Health.Status}}", *waiting.values()], 30.0).split()
        found = dict(zip(waiting, said, strict=True))
        assert time.monotonic() < deadline, found
        waiting = {service: waiting[service] for service, health in found.items() if health != "healthy"}
        if waiting:
            time.sleep(0.5)  # between two looks; the engine tells nobody
