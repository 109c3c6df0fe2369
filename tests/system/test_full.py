"""The train with everything, live: all sensors in use, and what a restarted process still knows."""

from __future__ import annotations

import os
import signal

from conftest import start

FULL = "deploy/trains/full.yaml"
TOP = "milepost/v1/full-1"
UNITS = {"odometer-front", "odometer-rear", "radar-front", "radar-rear", "loop", "imu", "gnss"}


def scale_std(estimate: dict) -> float:
    place = estimate["belief"]["states"].index("odometer-front.scale")
    return estimate["belief"]["covariance"][place][place] ** 0.5


def test_all_sensors_run_together_and_a_restarted_filter_still_knows_its_wheel(tmp_path):
    """GIVEN a train that has learned its wheels, WHEN a wheel's filter is killed, THEN its successor learns nothing anew.

    The prior of a wheel is ±1 %; a hundred metres make it ±0.1 %. The truth is inside its interval throughout.
    """
    stack, outside = start(FULL, "--state-dir", str(tmp_path))
    try:
        whole = outside.wait_state(
            f"{TOP}/state",
            lambda m: m["status"] == "normal" and {s["unit"] for s in m["sensors"]} == UNITS,
            40.0,
            "a normal state with all sensors",
        )
        assert whole["excluded"] == []
        estimates = f"{TOP}/estimate/odometer-front"
        # well below what is asked of the successor: its first belief has the share divided out of it, P/β
        outside.wait_for(lambda: outside.messages(estimates), 10.0, "an estimate")
        outside.wait_for(lambda: scale_std(outside.newest(estimates)) < 7e-4, 30.0, "the wheel learned to 0.07 %")
        first = outside.newest(estimates)["instance"]
        os.kill(stack.pid_of("filter", "odometer-front"), signal.SIGKILL)
        outside.wait_for(lambda: outside.newest(estimates)["instance"] != first, 20.0, "another instance")
        again = next(m for m in outside.messages(estimates) if m["instance"] != first)
        assert scale_std(again) < 1.5e-3
        assert not [e for e in outside.messages(f"{TOP}/event") if e["code"] == "calibration_restored"]
        outside.wait_state(f"{TOP}/state", lambda m: m["status"] == "normal", 20.0, "a normal state again")
        states, truths = outside.messages(f"{TOP}/state"), outside.messages(f"{TOP}/@sim/truth")
        where = {truth["measured_at_ns"]: truth["position_m"] for truth in truths}
        compared = [m for m in states if m["measured_at_ns"] in where]
        assert len(compared) > 100
        assert all(m["position_min_m"] <= where[m["measured_at_ns"]] <= m["position_max_m"] for m in compared)
    finally:
        outside.close()
        assert stack.stop() == 0
