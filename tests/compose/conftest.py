"""One running project for all tests of this folder that ask for it."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator

import pytest
import zenoh
from containers import COMPOSE_FILE, TRAIN, Stack, tell
from engine import find_compose, free_port


@pytest.fixture(scope="session")
def stack(request: pytest.FixtureRequest) -> Iterator[Stack]:
    tool, ports = find_compose(), [free_port(), free_port()]
    project = f"milepost-test-{os.getpid()}"
    stack = Stack(
        [*tool, "-f", str(COMPOSE_FILE), "-p", project],
        project,
        {**os.environ, "MILEPOST_PORT": str(ports[0]), "MILEPOST_PORT_2": str(ports[1])},
    )
    config = {
        "mode": "client",
        "connect": {
            "endpoints": [f"tcp/127.0.0.1:{port}" for port in ports],
            "timeout_ms": 30000,
            "exit_on_failure": True,
            "retry": {"period_init_ms": 20, "period_max_ms": 100, "period_increase_factor": 2},
        },
        "scouting": {"multicast": {"enabled": False}},
        # a router that says nothing is given up soon, and the other one is tried
        "transport": {"unicast": {"open_timeout": 300}, "link": {"tx": {"lease": 500, "keep_alive": 4}}},
    }
    listener, figures = stack.listener, stack.figures
    try:
        begun = time.monotonic()
        stack.call("build", timeout_s=900.0)
        figures["image built in s"] = time.monotonic() - begun
        begun = time.monotonic()
        stack.call("up", "-d")
        figures["`up -d` returned after s"] = time.monotonic() - begun
        with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
            kept = [
                session.declare_subscriber(f"{TRAIN}/state", listener.on_state),
                session.declare_subscriber(f"{TRAIN}/@sim/truth", listener.on_truth),
                session.liveliness().declare_subscriber(f"{TRAIN}/alive/*/*", listener.on_token, history=True),
            ]
            listener.wait(lambda: bool(listener.states), 60.0, "a first state")
            figures["first state after s"] = listener.states[0][0] - begun
            yield stack
            del kept
    finally:
        tell(request, stack)
        stack.call("down", "--volumes", "--remove-orphans", "--timeout", "5")
