"""All fusers die and nobody remembers a fused state: when they are back, the prior is that of the train's beginning."""

from __future__ import annotations

import os
import signal

import numpy as np
import yaml

from conftest import running
from lighter import lighter

STATE, TRUTH = "milepost/v1/full-1/state", "milepost/v1/full-1/@sim/truth"


def test_the_truth_is_inside_when_they_are_back(tmp_path) -> None:
    """GIVEN a train without feedback WHEN all its fusers die on the way THEN the truth is inside at once, and nobody blamed."""
    file = lighter("full", tmp_path)
    train = yaml.safe_load(file.read_text(encoding="utf-8"))
    train["fusion"]["feedback"] = False
    file.write_text(yaml.safe_dump(train), encoding="utf-8")
    with running(str(file), STATE) as (stack, outside):
        before = outside.newest(STATE)
        pids = [stack.pid_of("fuser"), stack.pid_of("fuser", "fuser-2")]
        for pid in pids:
            os.kill(pid, signal.SIGKILL)
        begun = len(outside.messages(STATE))
        back = outside.wait_state(
            STATE, lambda m: m["measured_at_ns"] > before["measured_at_ns"] + 5e8, 20.0, "a state of a new one"
        )
        outside.wait_state(STATE, lambda m: m["measured_at_ns"] > back["measured_at_ns"] + 5e9, 20.0, "five seconds more")
        truth = outside.messages(TRUTH)
        states = outside.messages(STATE)[begun:]
        told = [m["code"] for key in outside.heard if "/event" in key for m in outside.messages(key)]
    at_s = np.array([m["measured_at_ns"] - before["measured_at_ns"] for m in truth]) * 1e-9
    after = [(m, (m["measured_at_ns"] - before["measured_at_ns"]) * 1e-9) for m in states]
    judged = [(m, np.interp(t, at_s, [each["position_m"] for each in truth])) for m, t in after if t <= at_s[-1]]
    assert len(judged) > 50
    wrong = [m["measured_at_ns"] for m, position in judged if not m["position_min_m"] <= position <= m["position_max_m"]]
    assert not wrong, f"the truth was outside in {len(wrong)} of {len(judged)} states"
    assert "unit_excluded" not in told
