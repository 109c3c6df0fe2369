"""`milepost up --headless` as a child process, with ports of its own."""

from __future__ import annotations

import contextlib
import signal
import socket
import subprocess
import sys
import threading
from pathlib import Path

import psutil

END_S = 10.0


def free_port() -> int:
    """A TCP port of this machine on which nobody listens."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port


def title_of(pid: int) -> str:
    """What process lists show of a process; empty where it has ended."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_text(encoding="utf-8").rstrip("\0").replace("\0", " ")
    return ""


def has_ended(pid: int) -> bool:
    """Whether a process is no more, or only waits for its parent to ask for its exit code."""
    try:
        return psutil.Process(pid).status() == psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return True


class RunningTrain:
    """A train that `milepost up` runs; `errors` are the lines that it and its processes wrote.

    Without a name of its own, `options` say which trains: `--fleet`.
    """

    def __init__(self, train: str, *options: str) -> None:
        self.endpoint = f"tcp/127.0.0.1:{free_port()}"
        self.endpoints = [self.endpoint, *(each for each in options if each.startswith("tcp/"))]
        command = [sys.executable, "-m", "milepost", "up", "--headless", *(["--train", train] if train else [])]
        command += ["--listen", self.endpoint, *options]
        self.process = subprocess.Popen(command, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        self.errors: list[str] = []
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        self.errors.extend(self.process.stderr)

    def pid_of(self, *words: str) -> int:
        """The process whose title is `milepost run WORDS`. Raises LookupError."""
        for child in psutil.Process(self.process.pid).children():
            if title_of(child.pid) == " ".join(("milepost", "run", *words)):
                return child.pid
        raise LookupError(" ".join(words))

    def stop(self) -> int:
        """End it; returns its exit code."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
        return self.process.wait(END_S)
