"""What real processes log: one line a record, for people or for programs."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
from typing import Any

import pytest

from conftest import Outside, free_port

pytestmark = pytest.mark.long

MAGLEV = "deploy/trains/maglev.yaml"
LINE = re.compile(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{3}Z (debug|info|warning|error) (\S+): .+")
# the command itself, with a bug in one kind of process
WITH_A_BUG = """
import sys
from milepost.nodes.balise import BaliseNode
def tick(self, now_ns): raise RuntimeError("a bug\\nof two lines")
BaliseNode.tick, BaliseNode.next_tick_ns = tick, lambda self: 1
from milepost.cli.main import main
sys.argv = ["milepost", *sys.argv[1:]]
main()
"""


def said_until_stopped(router: str, *options: str, **variables: str) -> list[str]:
    """What the filter of the maglev's radar wrote, from its start to its end by SIGTERM."""
    command = [sys.executable, "-m", "milepost", "run", "filter", "radar", "--train", MAGLEV, "--connect", router, *options]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, env={**os.environ, **variables})
    with contextlib.closing(Outside(router)) as outside:
        outside.watch_tokens("milepost/v1/maglev-1/alive/**")
        outside.wait_for(lambda: any("/filter-radar/" in key for key in outside.tokens), 20.0, "the token")
        process.send_signal(signal.SIGTERM)
        _, said = process.communicate(timeout=10.0)
    assert process.returncode == 0
    return said.splitlines()


def records(lines: list[str]) -> list[dict[str, Any]]:
    assert lines
    found = [json.loads(line) for line in lines]
    for each in found:
        assert {"time", "level", "process", "message"} <= set(each) <= {"time", "level", "process", "train", "code", "message"}
    return found


def test_debug_lines_have_date_level_and_name(router):
    lines = said_until_stopped(router, "--log-level", "debug")
    found = [LINE.fullmatch(line) for line in lines]
    assert len(lines) >= 2
    assert all(found), lines
    assert {each[2] for each in found if each} == {"filter-radar"}
    assert "there as instance" in lines[0]


def test_what_is_for_debugging_is_not_said_unless_asked_for(router):
    # where the machine is slow, it has a router to wait for, and says so
    assert not [line for line in said_until_stopped(router) if " warning " not in line]


def test_json_is_asked_for_by_an_option_or_by_the_environment(router):
    by_option = said_until_stopped(router, "--log-level", "debug", "--log-format", "json")
    by_variable = said_until_stopped(router, MILEPOST_LOG_LEVEL="debug", MILEPOST_LOG_FORMAT="json")
    for lines in (by_option, by_variable):
        found = records(lines)
        assert {(each["process"], each["train"]) for each in found} == {("filter-radar", "maglev-1")}
        assert "debug" in {each["level"] for each in found}


@pytest.mark.parametrize("form", ["text", "json"])
@pytest.mark.parametrize("level", ["info", "debug"])
def test_a_bug_is_one_line_and_its_traceback_is_for_who_asks(form, level):
    """GIVEN a train with a process whose node raises, THEN it says in a line what and where; the traceback is for debugging."""
    options = ["up", "--headless", "--train", MAGLEV, "--listen", f"tcp/127.0.0.1:{free_port()}"]
    options += ["--log-format", form, "--log-level", level]
    lines = []
    with subprocess.Popen([sys.executable, "-c", WITH_A_BUG, *options], stderr=subprocess.PIPE, text=True) as process:
        for line in process.stderr:
            lines.append(line.rstrip("\n"))
            if "balise restarted" in line:
                process.send_signal(signal.SIGTERM)
    assert process.returncode == 0
    assert any("Traceback" in line for line in lines) == (level == "debug")
    if form == "json":
        found = [json.loads(line) for line in lines]
        bugs = [each for each in found if each["process"] == "balise" and each["message"].startswith("ends")]
        assert {each["level"] for each in bugs} == {"error"}
        assert all("RuntimeError: a bug" in each["message"] for each in bugs)
        assert all(("traceback" in each) == (level == "debug") for each in bugs)
        assert {"process_failed"} == {each["code"] for each in found if each["process"] == "balise" and "code" in each}
    else:
        bugs = [line for line in lines if "error balise: ends" in line]
        assert all("RuntimeError: a bug of two lines" in line for line in bugs)
        assert level == "debug" or all(LINE.fullmatch(line) or line.startswith("milepost: ") for line in lines), lines
    assert bugs


@pytest.mark.parametrize("together", [[], ["--together"]], ids=["processes", "together"])
def test_up_and_all_that_it_starts_log_json(together):
    """GIVEN `up --log-format json`, WHEN a scenario ends, THEN every line of all processes is a record with its process."""
    command = [sys.executable, "-m", "milepost", "up", "--headless", "--train", MAGLEV, "--duration", "3", *together]
    command += ["--listen", f"tcp/127.0.0.1:{free_port()}", "--log-format", "json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    found = records(done.stderr.splitlines())
    assert {"up", "display", "router"} <= {each["process"] for each in found}
    (listening,) = [each for each in found if each["process"] == "router"]
    assert listening["message"].startswith("listening on tcp/")
    assert done.stdout == ""


def test_a_level_that_is_none_is_one_line():
    done = subprocess.run(
        [sys.executable, "-m", "milepost", "up", "--log-level", "loud"], capture_output=True, text=True, timeout=60
    )
    assert (done.returncode, len(done.stderr.splitlines())) == (2, 1)
    assert "--log-level" in done.stderr
