"""A real train's position reports, as a stream and as `milepost etcs` prints them."""

from __future__ import annotations

import json
import re
import subprocess
import sys

import pytest

from conftest import free_port, running
from milepost.feeds.position_report import unpacked

STATE = "milepost/v1/regional-1/state"
REPORTS = "milepost/v1/regional-1/position_report"


@pytest.fixture(scope="module")
def train():
    """The regional train, running."""
    with running("regional", STATE) as found:
        yield found


def test_a_subscriber_gets_a_packet_each_second_that_says_what_the_state_says(train):
    _, outside = train
    begun = len(outside.messages(REPORTS))
    outside.wait_for(lambda: len(outside.messages(REPORTS)) >= begun + 3, 8.0, "three reports")
    for report in outside.messages(REPORTS)[begun:]:
        packet = unpacked(bytes.fromhex(report["packet_hex"]))
        assert packet["nid_packet"] == 0
        assert packet["l_packet"] == report["l_packet"] == 115
        state = next(state for state in outside.messages(STATE) if state["epoch"] == report["epoch"])
        assert packet["v_train"] == int(state["speed_mps"] * 3.6 / 5.0)
        assert packet["m_level"] == 3


def test_the_process_is_one_of_the_train_like_others(train):
    stack, outside = train
    assert stack.pid_of("etcs")
    outside.wait_for(lambda: outside.newest("milepost/v1/regional-1/health/etcs").get("sent_hz"), 5.0, "its health")
    assert outside.newest("milepost/v1/regional-1/health/etcs")["received_hz"]["state"] > 30.0


def etcs(*options: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "milepost", "etcs", *options], capture_output=True, text=True, timeout=30)


def test_the_command_prints_lines_for_people_and_json_for_machines(train):
    stack, _ = train
    said = etcs("--connect", stack.endpoint, "--count", "2")
    assert said.returncode == 0
    lines = said.stdout.splitlines()
    assert len(lines) == 2
    assert all(re.fullmatch(r"regional-1 \w+: .+, \d+ km/h \w+, FS L2, 115 bits [0-9a-f]{30}", line) for line in lines), lines
    (report,) = [json.loads(line) for line in etcs("--connect", stack.endpoint, "--count", "1", "--json").stdout.splitlines()]
    assert report["train"] == "regional-1"
    assert len(report["packet_hex"]) == 30


def test_without_a_router_the_command_is_one_line_and_exit_code_1():
    said = etcs("--connect", f"tcp/127.0.0.1:{free_port()}")
    assert (said.returncode, said.stdout, said.stderr.count("\n")) == (1, "", 1)
