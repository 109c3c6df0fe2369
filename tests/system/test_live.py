"""The train live over Zenoh, seen from outside with eclipse-zenoh and msgpack alone."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import msgpack
import numpy as np

from conftest import widest_m, width_m

STATE = "milepost/v1/maglev-1/state"
TRUTH = "milepost/v1/maglev-1/@sim/truth"


def units(state: dict) -> set[str]:
    return {sensor["unit"] for sensor in state["sensors"]}


def test_a_subscriber_gets_a_state_every_20_ms_with_the_truth_inside(maglev):
    _, outside = maglev
    begin = len(outside.messages(STATE))
    outside.wait_for(lambda: len(outside.heard[STATE]) >= begin + 300, 12.0, "300 states")
    states = outside.messages(STATE)[begin : begin + 300]
    epochs = [s["epoch"] for s in states]
    assert epochs == list(range(epochs[0], epochs[0] + 300))
    assert all(s["measured_at_ns"] == s["epoch"] * 20_000_000 for s in states)
    assert [s["sequence"] for s in states] == list(range(states[0]["sequence"], states[0]["sequence"] + 300))
    truths = {t["measured_at_ns"]: t for t in outside.messages(TRUTH)}
    pairs = [(s, truths[s["measured_at_ns"]]) for s in states if s["measured_at_ns"] in truths]
    assert len(pairs) > 250
    assert all(s["position_min_m"] <= t["position_m"] <= s["position_max_m"] for s, t in pairs)
    assert all(s["speed_min_mps"] <= t["speed_mps"] <= s["speed_max_mps"] for s, t in pairs)


def test_truth_stays_out_of_what_a_wildcard_hears(maglev):
    _, outside = maglev
    heard_plainly = []
    subscriber = outside.session.declare_subscriber("milepost/v1/**", lambda s: heard_plainly.append(str(s.key_expr)))
    outside.wait_for(lambda: len(heard_plainly) > 300, 10.0, "300 messages on **")
    subscriber.undeclare()
    assert not [key for key in heard_plainly if "@" in key]


def test_states_and_readings_are_sent_at_once_and_health_shares_packets(maglev):
    """A burst of samples that are sent one by one does not fit into a session's queue, and the rest of it is dropped."""
    _, outside = maglev
    alone: dict[str, bool] = {}

    def receive(sample):
        alone[str(sample.key_expr).split("/")[3]] = sample.express

    keys = [f"milepost/v1/maglev-1/{stream}" for stream in ("state", "reading/*", "health/*")]
    heard = [outside.session.declare_subscriber(key, receive) for key in keys]
    outside.wait_for(lambda: len(alone) == len(keys), 10.0, "a sample of each")
    for each in heard:
        each.undeclare()
    assert alone == {"state": True, "reading": True, "health": False}


def test_every_process_shows_health_once_a_second(maglev):
    _, outside = maglev
    names = ["fuser", "filter-radar", "filter-loop", "balise", "sensor-radar", "sensor-loop", "sensor-balise-reader", "world"]
    keys = [f"milepost/v1/maglev-1/health/{name}" for name in names]
    outside.wait_for(lambda: all(len(outside.heard.get(key, [])) >= 3 for key in keys), 10.0, "three healths of each")
    fuser = outside.messages(keys[0])[-1]
    assert 80.0 < fuser["received_hz"]["estimate"] < 260.0
    assert 40.0 < fuser["sent_hz"]["state"] < 60.0
    assert fuser["rewinds"] > 0
    assert fuser["step_us"]["p50"] > 0.0


def test_a_killed_sensor_is_excluded_at_once_and_comes_back(maglev):
    """GIVEN a normal train, WHEN the radar's process is killed, THEN the state goes on without it, and with it again."""
    stack, outside = maglev
    killed_ns = time.time_ns()
    os.kill(stack.pid_of("sensor", "radar"), signal.SIGKILL)
    gone = outside.wait_state(STATE, lambda m: "radar" not in units(m), 3.0, "a state without the radar")
    assert gone["excluded"] == [{"unit": "radar", "reason": "process gone", "kind": "absent"}]
    assert gone["status"] == "degraded"
    assert (gone["published_at_ns"] - killed_ns) * 1e-9 < 0.5
    back = outside.wait_state(STATE, lambda m: m["status"] == "normal" and "radar" in units(m), 20.0, "the radar back")
    during = [m for m in outside.messages(STATE) if gone["epoch"] <= m["epoch"] <= back["epoch"]]
    assert [m["epoch"] for m in during] == list(range(gone["epoch"], back["epoch"] + 1))


def test_a_killed_fuser_continues_where_the_train_is(maglev):
    """GIVEN a train kilometres from its prior's certainty, WHEN the fuser is killed, THEN the next one knows where it is."""
    stack, outside = maglev
    outside.wait_state(STATE, lambda m: m["last_balise"] is not None, 20.0, "a balise")
    os.kill(stack.pid_of("fuser"), signal.SIGKILL)
    before = outside.messages(STATE)[-1]
    first = outside.wait_state(STATE, lambda m: m["instance"] != before["instance"], 20.0, "a state of the new fuser")

    def truth():
        return next((t for _, t in outside.heard[TRUTH] if t["measured_at_ns"] == first["measured_at_ns"]), None)

    true = outside.wait_for(truth, 5.0, "the truth of that epoch")
    assert first["position_min_m"] <= true["position_m"] <= first["position_max_m"]
    assert width_m(first) < widest_m(before, first)


def test_a_killed_filter_costs_its_unit_for_a_moment_and_the_state_nothing(maglev):
    stack, outside = maglev
    os.kill(stack.pid_of("filter", "loop"), signal.SIGKILL)
    outside.wait_state(STATE, lambda m: "loop" not in units(m), 3.0, "a state without the loop")
    outside.wait_state(STATE, lambda m: m["status"] == "normal", 20.0, "normal again")
    truths = {t["measured_at_ns"]: t for t in outside.messages(TRUTH)}
    states = [m for m in outside.messages(STATE) if m["measured_at_ns"] in truths]
    assert all(m["position_min_m"] <= truths[m["measured_at_ns"]]["position_m"] <= m["position_max_m"] for m in states)


def test_garbage_is_refused_counted_and_reported_and_changes_nothing(maglev):
    _, outside = maglev
    begun = len(outside.messages(STATE))
    reading = outside.messages("milepost/v1/maglev-1/reading/radar")[-1]
    wrong = [
        b"\xc1garbage",
        msgpack.packb({**reading, "speed_mps": float("nan")}),
        msgpack.packb({**reading, "speed_mps": "fast"}),
        msgpack.packb({k: v for k, v in reading.items() if k != "sequence"}),
        msgpack.packb({**reading, "train": "another"}),
        msgpack.packb({**reading, "unit": "loop"}),
        msgpack.packb(reading),
        msgpack.packb({**reading, "sequence": 10**9, "measured_at_ns": reading["measured_at_ns"] - 20 * 10**9}),
        msgpack.packb({**reading, "sequence": 10**9 + 1, "measured_at_ns": reading["measured_at_ns"] + 20 * 10**9}),
    ]
    for payload in wrong:
        outside.session.put("milepost/v1/maglev-1/reading/radar", payload)
    outside.session.put("milepost/v1/maglev-1/reading/*", msgpack.packb(reading))
    outside.session.put("milepost/v1/maglev-1/fix/balise", b"")
    outside.session.put("milepost/v1/maglev-1/estimate/radar", b"\x00" * 1000)
    estimate = outside.newest("milepost/v1/maglev-1/estimate/radar")
    outside.session.put("milepost/v1/maglev-1/estimate/nobody", msgpack.packb(estimate))
    filter_health, fuser_health = (f"milepost/v1/maglev-1/health/{name}" for name in ("filter-radar", "fuser"))
    expected = {
        "undecodable": 1,
        "invalid": 3,
        "other_train": 1,
        "other_unit": 1,
        "duplicate": 1,
        "too_old": 1,
        "from_future": 1,
    }

    def counted():
        refused = outside.newest(filter_health).get("refused", {})
        return all(refused.get(reason, 0) >= count for reason, count in expected.items()) and "wildcard_key" in refused

    outside.wait_for(counted, 5.0, f"the filter counting {expected}")
    before = outside.newest(filter_health)["refused"]["invalid"]

    def counted_feedback():
        # a filter opens the newest feedback that waits, and while it was busy that may have been a good one
        outside.session.put("milepost/v1/maglev-1/feedback", msgpack.packb([1, 2, 3]))
        return outside.newest(filter_health)["refused"]["invalid"] > before

    outside.wait_for(counted_feedback, 5.0, "the filter counting garbage on feedback")
    outside.wait_for(
        lambda: {"undecodable", "other_unit"} <= set(outside.newest(fuser_health).get("refused", {})),
        5.0,
        "the fuser counting",
    )
    assert [e for e in outside.messages("milepost/v1/maglev-1/event") if e["code"] == "refused_from_future"]
    truths = {t["measured_at_ns"]: t for t in outside.messages(TRUTH)}
    states = [m for m in outside.messages(STATE)[begun:] if m["measured_at_ns"] in truths]
    errors = np.array([m["position_m"] - truths[m["measured_at_ns"]]["position_m"] for m in states])
    assert np.abs(errors).max() < 0.3


def test_the_readmes_dispatch_subscriber_runs_as_printed(maglev):
    stack, _ = maglev
    text = Path("README.md").read_text(encoding="utf-8")
    program = re.search(r"```python\n(.*?)```", text, re.S).group(1)
    assert len(program.strip().splitlines()) <= 12
    program = program.replace("tcp/127.0.0.1:7447", stack.endpoint)
    shown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    lines = shown.stdout.strip().splitlines()
    assert len(lines) == 5
    assert all(re.fullmatch(r"maglev-1 \d+\.\d+ m \[\d+\.\d+, \d+\.\d+\] \d+\.\d+ km/h normal", line) for line in lines), lines


def test_status_says_normal_with_exit_code_0_and_1_where_there_is_nothing(maglev):
    stack, _ = maglev
    command = [sys.executable, "-m", "milepost", "status", "--connect"]
    good = subprocess.run([*command, stack.endpoint], capture_output=True, text=True, timeout=30)
    assert (good.returncode, "normal" in good.stdout) == (0, True)
    bad = subprocess.run([*command, "tcp/127.0.0.1:1"], capture_output=True, text=True, timeout=30)
    assert (bad.returncode, bad.stderr.count("\n")) == (1, 1)
