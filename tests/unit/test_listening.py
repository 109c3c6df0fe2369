"""A tool that listens writes nothing to standard output but its answer, whatever Zenoh has to say."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

# Zenoh has seldom an error to log: here it logs all that it does, unless it is told to be silent
PROGRAM = """
import sys
import zenoh
from milepost.runtime.bus import open_session
from milepost.runtime.listening import listening

ALONE = {"mode": "peer", "scouting": {"multicast": {"enabled": False}}, "listen": {"endpoints": ["tcp/127.0.0.1:0"]}}
begin = zenoh.init_log_from_env_or
zenoh.init_log_from_env_or = lambda level: begin(level if level == "off" else "debug")

opened = listening([], (), "t", print, config=lambda endpoints: ALONE) if sys.argv[1] == "tool" else open_session(ALONE)
with opened:
    pass
print("answer", flush=True)
"""


@pytest.mark.parametrize(("who", "logs"), [("tool", False), ("node", True)])
def test_a_tools_standard_output_is_its_answer_alone(who: str, logs: bool) -> None:
    command = [sys.executable, "-c", PROGRAM, who]
    env = {name: value for name, value in os.environ.items() if name != "RUST_LOG"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=30, check=True, env=env)
    lines = done.stdout.splitlines()
    assert "answer" in lines
    assert (len(lines) > 1) is logs
