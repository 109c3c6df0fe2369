"""compose.yaml with compose.secure.yaml: the same train, for those with a certificate alone."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh
from containers import COMPOSE_FILE, SERVICES, TRAIN, Stack, advancing, check_against_truth, is_whole, tell
from engine import ROOT, find_compose, free_port, wait_until_healthy

from milepost.runtime import zenoh_config

pytestmark = pytest.mark.compose
pytest.importorskip("cryptography")
USER = 10001


def make_certificates(folder: Path) -> None:
    endpoints = ["--listen", "tls/0.0.0.0:7447"] * 2 + ["--connect", "tls/router:7447", "--connect", "tls/router-2:7447"]
    command = [sys.executable, "-m", "milepost", "pki", "init", "--dir", str(folder), "--owner", str(USER), *endpoints]
    subprocess.run(command, check=True, timeout=60.0)


@pytest.fixture(scope="module")
def stack(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stack]:
    tool, ports = find_compose(), (free_port(), free_port())
    if os.geteuid() != 0:
        pytest.skip("only root can give keys to the user of the containers")
    pki = tmp_path_factory.mktemp("certificates") / "pki"
    make_certificates(pki)
    project = f"milepost-secure-{os.getpid()}"
    environment = {
        **os.environ,
        "MILEPOST_PKI": str(pki),
        "MILEPOST_PORT": str(ports[0]),
        "MILEPOST_PORT_2": str(ports[1]),
    }
    files = ["-f", str(COMPOSE_FILE), "-f", str(ROOT / "compose.secure.yaml")]
    stack = Stack([*tool, *files, "-p", project], project, environment)
    config = zenoh_config.client(pki / "dispatch" / "session.json5")
    config["connect"]["endpoints"] = [f"tls/127.0.0.1:{port}" for port in ports]
    listener = stack.listener
    try:
        stack.call("build", timeout_s=900.0)
        stack.call("up", "-d")
        with zenoh.open(zenoh.Config.from_json5(json.dumps(config))) as session:
            kept = [
                session.declare_subscriber(f"{TRAIN}/state", listener.on_state),
                session.declare_subscriber(f"{TRAIN}/@sim/truth", listener.on_truth),
            ]
            listener.wait(lambda: bool(listener.states), 60.0, "a first state")
            yield stack
            del kept
    finally:
        tell(request, stack)
        stack.call("down", "--volumes", "--remove-orphans", "--timeout", "5")


def test_state_comes_at_50_hz_and_is_right(stack: Stack) -> None:
    listener = stack.listener
    heard = listener.span(listener.wait_for_state(is_whole, 60.0, "a normal state with all sensors"), epochs=250)
    newest = advancing(heard)
    rate_hz = stack.figures["states a second"] = (len(newest) - 1) / (newest[-1][0] - newest[0][0])
    assert 45.0 < rate_hz < 55.0
    check_against_truth(stack, heard)


def test_a_tool_without_a_certificate_is_refused_and_the_router_says_so(stack: Stack) -> None:
    config = zenoh_config.tool([f"tcp/127.0.0.1:{stack.environment['MILEPOST_PORT']}"], 1500)
    with pytest.raises(zenoh.ZError, match="Unable to connect"):
        zenoh.open(zenoh.Config.from_json5(json.dumps(config)))
    said = subprocess.run(
        ["docker", "logs", stack.container("router")], capture_output=True, text=True, check=True, timeout=30.0
    )
    assert "a connection was refused: received corrupt message" in said.stderr + said.stdout


@pytest.mark.parametrize("service", ["fuser", "sensor-radar-front"])
def test_a_container_has_its_own_key_alone_and_cannot_change_it(stack: Stack, service: str) -> None:
    mounts = {mount["Destination"]: mount for mount in stack.inspect(service)["Mounts"]}
    assert mounts["/run/milepost"]["Source"].endswith(f"/{service}")
    assert not mounts["/run/milepost"]["RW"]
    listed = stack.inside(service, "stat -c '%u %a %n' /run/milepost/identity.pem; ls /run; ls /run/milepost")
    assert listed.startswith(f"{USER} 600 /run/milepost/identity.pem")
    assert "ca.key" not in listed
    assert "OK" not in stack.inside(service, "touch /run/milepost/identity.pem 2>/dev/null && echo OK || true")


def test_every_container_becomes_healthy_within_its_limits(stack: Stack) -> None:
    containers = {service: stack.container(service) for service in SERVICES}
    wait_until_healthy(containers, 120.0)
    for service, container in containers.items():
        limits = stack.inspect(service)["HostConfig"]
        assert limits["PidsLimit"] == 128, container
        assert limits["NanoCpus"] == 10**9
    restarts = {service: stack.inspect(service)["RestartCount"] for service in SERVICES}
    assert restarts == dict.fromkeys(SERVICES, 0)
