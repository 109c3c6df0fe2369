"""One process: how it starts, waits, ends and dies."""

from __future__ import annotations

import contextlib
import json
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil

from conftest import Outside, free_port, start

CRASHING = """
import sys
from milepost.nodes.base import Node
from milepost.runtime.bus import ZenohBus, open_session
from milepost.runtime.clock import Clock
from milepost.runtime.runner import Runner
from milepost.runtime.zenoh_config import client

class Crashing(Node):
    def next_tick_ns(self): return 1
    def tick(self, now_ns):
        if self.ticks > 200: raise RuntimeError("a bug")
        self.ticks += 1
        return ()
    ticks = 0

with open_session(client([sys.argv[1]])) as session:
    bus = ZenohBus(session, "t")
    bus.declare_alive("crashing", "i")
    node = Crashing("t", "crashing", "i")
    Runner("crashing", node, bus, Clock()).run()
"""


MAGLEV = "deploy/trains/maglev.yaml"
ROUTER_FILE = Path(__file__).resolve().parents[2] / "deploy/zenoh/router.json5"


def spawn(router: str, *arguments: str) -> subprocess.Popen:
    command = [sys.executable, "-m", "milepost", "run", *arguments, "--train", MAGLEV, "--connect", router]
    return subprocess.Popen(command, stderr=subprocess.PIPE)


def alive(outside: Outside, unit: str):
    return lambda: [k for k, there in outside.tokens.items() if f"/alive/{unit}/" in k and there]


def gone(outside: Outside, unit: str):
    return lambda: not alive(outside, unit)()


def test_sigterm_and_sigint_end_a_process_in_under_a_second_with_its_token_gone(router):
    outside = Outside(router)
    outside.watch_tokens("milepost/v1/*/alive/**")
    for number in (signal.SIGTERM, signal.SIGINT):
        process = spawn(router, "filter", "radar")
        outside.wait_for(alive(outside, "filter-radar"), 20.0, "the token")
        begun = time.monotonic()
        process.send_signal(number)
        outside.wait_for(gone(outside, "filter-radar"), 1.0, "the token gone")
        assert process.wait(1.0) == 0
        assert time.monotonic() - begun < 1.0
    outside.close()


def test_a_killed_process_loses_its_token_at_once(router):
    outside = Outside(router)
    outside.watch_tokens("milepost/v1/*/alive/**")
    process = spawn(router, "sensor", "radar")
    outside.wait_for(alive(outside, "sensor-radar"), 20.0, "the token")
    process.kill()
    outside.wait_for(gone(outside, "sensor-radar"), 0.5, "the token gone")
    process.wait()
    outside.close()


def test_a_crash_ends_the_process_at_once_with_its_token_and_a_code(router):
    """An exception in the main thread must not leave a zombie that still shows its token."""
    outside = Outside(router)
    outside.watch_tokens("milepost/v1/*/alive/**")
    process = subprocess.Popen([sys.executable, "-c", CRASHING, router], stderr=subprocess.PIPE, text=True)
    outside.wait_for(lambda: any("/alive/crashing/" in key for key in outside.tokens), 20.0, "the token")
    outside.wait_for(gone(outside, "crashing"), 5.0, "the token gone")
    assert process.wait(2.0) == 1
    assert "a bug" in process.stderr.read()
    outside.close()


def test_a_process_waits_for_a_router_that_is_not_there_and_can_be_stopped_meanwhile():
    process = spawn("tcp/127.0.0.1:1", "filter", "radar")
    time_to_start = 3.0
    try:
        process.wait(time_to_start)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGTERM)
    assert process.wait(2.0) in (0, -signal.SIGTERM)


def test_a_replayed_train_ends_by_itself_with_code_0(tmp_path):
    """GIVEN three seconds of scenario, WHEN they are over, THEN every process has ended and `up` returns 0."""
    report = tmp_path / "report.json"
    command = [sys.executable, "-m", "milepost", "up", "--headless", "--duration", "3", "--report", str(report)]
    done = subprocess.run([*command, "--listen", f"tcp/127.0.0.1:{free_port()}"], capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    found = json.loads(report.read_text())
    assert found["states"] >= 145
    assert found["truth"]["outside_interval"] == 0
    # how long and how much is for the bench; here only that both are measured
    assert 1.0 < found["first_state_s"] < 60.0
    assert found["memory_pss_mib"] > 50.0


def test_ctrl_c_ends_everything_and_leaves_nothing_behind():
    stack, outside = start("deploy/trains/maglev.yaml")
    outside.wait_state("milepost/v1/maglev-1/state", lambda m: m["status"] == "normal", 40.0, "a normal state")
    outside.close()
    children = psutil.Process(stack.process.pid).children(recursive=True)
    stack.process.send_signal(signal.SIGINT)
    assert stack.process.wait(8.0) == 0
    assert not [child for child in children if child.is_running() and child.status() != psutil.STATUS_ZOMBIE]


def test_a_router_runs_from_a_configuration_file(tmp_path):
    """The file that compose.yaml names, on a free port of this machine."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    file = tmp_path / "router.json5"
    file.write_text(re.sub(r"tcp/[^\"']+", endpoint, ROUTER_FILE.read_text(encoding="utf-8")), encoding="utf-8")
    command = [sys.executable, "-m", "milepost", "run", "router", "--config", str(file)]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True) as process:
        try:
            assert process.stderr is not None
            assert f"listening on {endpoint}" in process.stderr.readline()
            with contextlib.closing(Outside(endpoint)) as outside:
                assert outside.session.zid()
        finally:
            process.terminate()
        assert process.wait(5) == 0
