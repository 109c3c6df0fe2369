"""Starts a train's processes on this machine, starts again what dies, ends them all together."""

from __future__ import annotations

import logging
import os
import signal
import socket
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from milepost.config.roles import ROLES, processes
from milepost.config.train import Train

log = logging.getLogger("milepost")
RESTART_AFTER_S = 0.5
LONGEST_WAIT_S = 8.0
CONFIGURATION_ERROR = 2
KILL_AFTER_S = 3.0


@dataclass
class Child:
    """A process and how it came about."""

    name: str
    command: list[str]
    process: subprocess.Popen[bytes]
    restart: bool = True
    restarts: int = 0
    again_at: float | None = None

    @property
    def running(self) -> bool:
        """Whether it has not ended."""
        return self.process.poll() is None


class Supervisor:
    """The processes of `milepost up`. Children get a session of their own, so that Ctrl-C reaches them through us, in order."""

    def __init__(self, log_file: Path | None = None) -> None:
        self.children: list[Child] = []
        self._log_file = log_file

    def start(self, name: str, arguments: Sequence[str], restart: bool = True) -> Child:
        """Start `milepost ARGUMENTS`."""
        command = [sys.executable, "-m", "milepost", *arguments]
        child = Child(name, command, self._spawn(command), restart)
        self.children.append(child)
        return child

    def _spawn(self, command: list[str]) -> subprocess.Popen[bytes]:
        environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1"}
        if self._log_file is None:
            return subprocess.Popen(command, start_new_session=True, stdin=subprocess.DEVNULL, env=environment)
        with self._log_file.open("ab") as file:
            return subprocess.Popen(
                command, start_new_session=True, stdin=subprocess.DEVNULL, stdout=file, stderr=file, env=environment
            )

    def watch(self) -> list[str]:
        """Start again what has died, a moment after. Returns sentences about what happened."""
        said = []
        for child in self.children:
            code = child.process.poll()
            # with exit code 2 it would end the same way again; after the scenario's end it would wait for ever
            if code is None or code == 0 or not child.restart or self._scenario_over():
                continue
            if code == CONFIGURATION_ERROR:
                child.restart = False
                said.append(f"{child.name} cannot run: see its line above")
            elif child.again_at is None:
                wait_s = min(RESTART_AFTER_S * 2**child.restarts, LONGEST_WAIT_S)
                child.again_at = time.monotonic() + wait_s
                said.append(f"{child.name} ended with {_why(code)}")
            elif time.monotonic() >= child.again_at:
                child.again_at = None
                child.restarts += 1
                child.process = self._spawn(child.command)
                said.append(f"{child.name} started again")
        return said

    def _scenario_over(self) -> bool:
        return any(child.name == "world" and child.process.poll() == 0 for child in self.children)

    def stop(self) -> None:
        """SIGTERM to all but the router, which goes last; SIGKILL to what is still there after three seconds."""
        routers = [child for child in self.children if child.name == "router"]
        for group in ([child for child in self.children if child not in routers], routers):
            for child in group:
                if child.running:
                    child.process.send_signal(signal.SIGTERM)
            deadline = time.monotonic() + KILL_AFTER_S
            for child in group:
                try:
                    child.process.wait(max(0.0, deadline - time.monotonic()))
                except subprocess.TimeoutExpired:
                    log.warning("%s did not end; killed", child.name)
                    child.process.kill()
                    child.process.wait()


def _why(code: int) -> str:
    if code < 0:
        return f"signal {signal.Signals(-code).name}"
    return f"exit code {code}"


def port_is_free(endpoint: str) -> bool:
    """Whether a tcp/HOST:PORT endpoint can be listened on. Raises ValueError for what is not one."""
    host, _, port = endpoint.removeprefix("tcp/").rpartition(":")
    if not (endpoint.startswith("tcp/") and host and port.isdecimal() and int(port) < 2**16):
        raise ValueError(f"{endpoint!r} is not tcp/HOST:PORT")
    with socket.socket(socket.AF_INET6 if ":" in host else socket.AF_INET, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host.strip("[]"), int(port)))
        except OSError:
            return False
    return True


def start_train(
    supervisor: Supervisor, train: Train, endpoint: str, speed: float, duration_s: float | None, state_dir: Path | None
) -> None:
    """Start the router and all processes of a train."""
    parent = ["--parent", str(os.getpid())]
    supervisor.start("router", ["run", "router", "--listen", endpoint, *parent])
    common = ["--train", str(train.path), "--connect", endpoint, *parent]
    for process in processes(train):
        unit = [process.unit] if ROLES[process.role].per_unit else []
        world = ["--speed", str(speed)] if process.role == "world" else []
        length = ["--duration", str(duration_s)] if ROLES[process.role].uses_world and duration_s else []
        state = ["--state-dir", str(state_dir)] if state_dir and process.role == "filter" else []
        command = ["run", process.role, *unit, *common, *world, *length, *state]
        # a world that begins again would put truth and sensors on different times
        supervisor.start(process.name, command, restart=process.role != "world")
