"""How a command with processes of its own is ended, and what it must leave."""

from __future__ import annotations

import os
import signal
import subprocess

import psutil


def end(running: subprocess.Popen[bytes], how: signal.Signals) -> None:
    """Interrupt the whole group, or kill the first process alone; neither leaves a traceback or a process."""
    children = psutil.Process(running.pid).children()
    (os.killpg if how == signal.SIGINT else os.kill)(running.pid, how)
    _, said = running.communicate(timeout=60)
    _, left = psutil.wait_procs(children, timeout=30)
    assert running.returncode == (130 if how == signal.SIGINT else -signal.SIGKILL)
    assert b"Traceback" not in said, said.decode()
    assert not left
