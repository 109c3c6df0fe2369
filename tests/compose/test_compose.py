"""compose.yaml brought up for real and looked at from outside, as a dispatch tool would: only eclipse-zenoh and msgpack."""

from __future__ import annotations

import json
import statistics
import subprocess
import time
from itertools import pairwise

import pytest
from containers import EPOCH_NS, SERVICES, UNITS, Stack, advancing, check_against_truth, is_whole, units
from engine import run, wait_until_healthy

pytestmark = pytest.mark.compose

# without a token's word, a unit's silence is noticed after one second
SILENCE_S = 1.0
# what a dispatch tool may count on, and of which type
FIELDS: dict[str, type | tuple[type, ...]] = {
    "train": str,
    "unit": str,
    "instance": str,
    "sequence": int,
    "measured_at_ns": int,
    "published_at_ns": int,
    "epoch": int,
    "position_m": float,
    "speed_mps": float,
    "acceleration_mps2": float,
    "covariance": list,
    "position_min_m": float,
    "position_max_m": float,
    "speed_min_mps": float,
    "speed_max_mps": float,
    "direction": str,
    "status": str,
    "line": str,
    "line_hash": str,
    "last_balise": (dict, type(None)),
    "sensors": list,
    "excluded": list,
    "awaiting": list,
    "settled": bool,
}


def test_state_comes_at_50_hz_and_is_right(stack: Stack) -> None:
    listener = stack.listener
    heard = listener.span(listener.wait_for_state(is_whole, 60.0, "a normal state with all sensors"), epochs=500)
    newest = advancing(heard)
    rate_hz = (len(newest) - 1) / (newest[-1][0] - newest[0][0])
    stack.figures["states a second"] = rate_hz
    stack.figures["median age ms"] = statistics.median(s["published_at_ns"] - s["measured_at_ns"] for _, s in heard) / 1e6
    assert 45.0 < rate_hz < 55.0
    for unit in {state["unit"] for _, state in heard}:
        epochs = [state["epoch"] for _, state in heard if state["unit"] == unit]
        assert epochs == sorted(set(epochs)), f"an epoch of {unit} came twice or out of order"
    assert len(newest) >= 490
    assert {state["status"] for _, state in heard} == {"normal"}
    assert listener.encodings == {"application/msgpack;state/1"}
    for _, state in heard:
        wrong = {
            name: state.get(name, "is missing") for name, kind in FIELDS.items() if not isinstance(state.get(name, ...), kind)
        }
        assert not wrong
        assert state["measured_at_ns"] == state["epoch"] * EPOCH_NS
        assert [len(row) for row in state["covariance"]] == [3, 3, 3]
        assert sum(sensor["share"] for sensor in state["sensors"]) == pytest.approx(1.0)
    check_against_truth(stack, heard)


def test_every_container_becomes_healthy(stack: Stack) -> None:
    waiting = {service: stack.container(service) for service in SERVICES}
    wait_until_healthy(waiting, 90.0)


@pytest.mark.parametrize("service", SERVICES)
def test_no_root_nothing_writable_no_multicast(stack: Stack, service: str) -> None:
    owners = run(["docker", "top", stack.container(service), "-eo", "uid,pid,args"], 30.0).splitlines()[1:]
    assert owners
    assert all(int(line.split()[0]) != 0 for line in owners), owners
    mounts = [line.split() for line in stack.inside(service, "cat /proc/1/mounts").splitlines()]
    options = {mount[1]: mount[3].split(",") for mount in mounts}
    assert "ro" in options["/"]
    assert "rw" in options["/tmp"]
    assert stack.inside(service, "touch /tmp/here && rm /tmp/here && echo writable") == "writable\n"
    assert "NoNewPrivs:\t1" in stack.inside(service, "cat /proc/1/status")
    # 224.0.0.1, all hosts, is the kernel's own; the numbers are written backwards
    groups = [line.split()[0] for line in stack.inside(service, "cat /proc/net/igmp").splitlines() if line.startswith("\t")]
    assert set(groups) <= {"010000E0"}, groups


def test_a_killed_sensor_is_out_at_once_and_back_when_started(stack: Stack) -> None:
    listener = stack.listener
    before = listener.wait_for_state(is_whole, 30.0, "a normal state to begin with")
    tokens = len(listener.tokens)
    run(["docker", "kill", stack.container("sensor-radar-front")], 30.0)
    listener.wait(
        lambda: any(not alive for _, _, alive in listener.tokens[tokens:]), 10.0, "the token of sensor-radar-front to go"
    )
    process, gone_at, _ = next(token for token in listener.tokens[tokens:] if not token[2])
    assert process == "sensor-radar-front"

    out = listener.wait_for_state(lambda state: "radar-front" in units(state, "excluded"), 10.0, "the radar excluded", before)
    out_at, state = listener.states[out]
    stack.figures["sensor out after its token ms"] = (out_at - gone_at) * 1e3
    assert {"unit": "radar-front", "reason": "process gone", "kind": "absent"} in state["excluded"]
    assert out_at - gone_at < SILENCE_S / 2, "the token did not do it"
    heard = listener.span(out, epochs=100)
    for _, state in heard:
        assert state["status"] == "degraded"
        assert set(units(state, "sensors")) == UNITS - {"radar-front"}
        assert sum(sensor["share"] for sensor in state["sensors"]) == pytest.approx(1.0)
    check_against_truth(stack, heard)
    received = [at for at, _ in listener.states[before : out + 1]]
    assert max(b - a for a, b in pairwise(received)) < SILENCE_S, "the state stopped meanwhile"
    assert stack.inspect("sensor-radar-front")["State"]["Status"] == "exited", "`docker kill` is an order, not a crash"

    stack.call("start", "sensor-radar-front")
    back = listener.wait_for_state(is_whole, 20.0, "the radar in use again and a normal state")
    check_against_truth(stack, listener.span(back, epochs=50))


def test_a_crashed_process_comes_back_by_itself(stack: Stack) -> None:
    listener = stack.listener
    before = listener.wait_for_state(is_whole, 30.0, "a normal state to begin with")
    # PID 1 is the engine's init; its child is the process
    stack.inside("filter-loop", "kill -KILL $(cat /proc/1/task/1/children)")
    out = listener.wait_for_state(lambda state: "loop" in units(state, "excluded"), 10.0, "loop excluded", before)
    assert {"unit": "loop", "reason": "process gone", "kind": "absent"} in listener.states[out][1]["excluded"]
    back = listener.wait_for_state(is_whole, 20.0, "loop in use again and a normal state", out)
    stack.figures["crash to normal again s"] = listener.states[back][0] - listener.states[out][0]
    assert stack.inspect("filter-loop")["RestartCount"] == 1
    check_against_truth(stack, listener.span(back, epochs=50))


@pytest.mark.parametrize("service", SERVICES)
def test_every_line_of_a_log_is_a_record(stack: Stack, service: str) -> None:
    """GIVEN containers that were killed, crashed and came back, THEN programs can read every line of their logs."""
    command = ["docker", "logs", stack.container(service)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=30.0)
    for line in (done.stdout + done.stderr).splitlines():
        record = json.loads(line)
        assert record["process"] == service
        assert record["level"] in ("info", "warning", "error")
        assert "Traceback" not in line


# the last one: nothing runs after it
def test_stop_ends_every_process_cleanly(stack: Stack) -> None:
    begun = time.monotonic()
    stack.call("stop")
    took_s = stack.figures["stopped within s"] = time.monotonic() - begun
    ends = {service: stack.inspect(service)["State"] for service in SERVICES}
    assert {service: end["ExitCode"] for service, end in ends.items()} == dict.fromkeys(SERVICES, 0)
    assert {end["Status"] for end in ends.values()} == {"exited"}
    assert took_s < 20.0
    # up to the microsecond: the engine writes as many digits as it likes
    finished = {service: end["FinishedAt"][:26] for service, end in ends.items()}
    last = sorted(finished, key=lambda service: finished[service])[-2:]
    assert set(last) == {"router", "router-2"}, "the others could not say goodbye"
