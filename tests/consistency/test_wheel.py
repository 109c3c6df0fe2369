"""A wheel of unknown diameter beside a radar: what is learned of it is as sure as it says, and slip does not get in."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from milepost.config.train import load_train
from milepost.nodes.base import Output
from milepost.offline.run import OFFLINE_START_NS, simulate
from milepost_schemas import Event, FusedState, Truth

pytestmark = pytest.mark.long

RADAR = {"kind": "doppler_radar", "rate_hz": 10.0, "speed_variance_m2ps2": 0.04}
ODOMETER = {"kind": "odometer", "diameter_m": 0.81, "scale_std": 0.06, "scale_noise_psd": 0.0, "speed_noise_std_mps": 0.05}
TRAIN: dict[str, Any] = {
    "train": "metro-1",
    "line": "line.yaml",
    "motion_model": {"jerk_psd_m2ps5": 1e-3},
    "prior": {
        "position_m": 0.0,
        "position_std_m": 0.5,
        "speed_mps": 22.2,
        "speed_std_mps": 1.0,
        "acceleration_std_mps2": 0.1,
    },
    "world": {"motion": {"kind": "white_jerk", "profile": [[0.0, 22.2]], "jerk_psd_m2ps5": 1e-3, "start_std": [0.5, 1.0, 0.1]}},
    "units": {"odo-1": ODOMETER, "odo-2": ODOMETER, "radar-1": RADAR, "radar-2": RADAR},
}
RUNS = 25


class Run:
    """What an offline run of this train said: settled states, truth, events, and scales with their deviations, by unit."""

    def __init__(self, folder: Path, change: dict[str, Any], length_s: float) -> None:
        (folder / "line.yaml").write_text("line: l\nlength_m: 20000.0\n")
        (folder / "train.yaml").write_text(yaml.safe_dump(TRAIN))
        self.train = load_train(folder / "train.yaml", change)
        self.states: dict[int, FusedState] = {}
        self.truth: dict[int, np.ndarray] = {}
        self.events: list[Event] = []
        simulate(self.train, length_s, self._tap, self._keep)

    def _tap(self, output: Output, now_ns: int) -> None:
        message = output.message
        if isinstance(message, Truth):
            truth = np.array([message.position_m, message.speed_mps, message.acceleration_mps2])
            self.truth[message.measured_at_ns] = truth
        elif isinstance(message, Event):
            self.events.append(message)

    def _keep(self, state: FusedState) -> None:
        self.states[state.measured_at_ns] = state

    def nees(self, at_s: float) -> float:
        at = OFFLINE_START_NS + round(at_s * 1e9)
        state = self.states[at]
        e = np.array([state.position_m, state.speed_mps, state.acceleration_mps2]) - self.truth[at]
        return float(e @ np.linalg.solve(np.array(state.covariance), e))

    def worst_speed_error(self, from_s: float, to_s: float) -> float:
        span = range(OFFLINE_START_NS + round(from_s * 1e9), OFFLINE_START_NS + round(to_s * 1e9))
        return max(abs(s.speed_mps - self.truth[at][1]) for at, s in self.states.items() if at in span)


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[Run]:
    folder = tmp_path_factory.mktemp("wheels")
    return [Run(folder, {"world": {"seed": 100 + i}}, 6.0) for i in range(RUNS)]


@pytest.mark.parametrize("at_s", [0.5, 2.0, 5.9])
def test_a_train_with_unknown_wheels_is_consistent(runs: list[Run], at_s: float) -> None:
    """The mean of 25 chi-square variables of 3 degrees: 3 ± 2.6 · √(6/25), 99 %."""
    assert np.mean([run.nees(at_s) for run in runs]) == pytest.approx(3.0, abs=2.6 * (6.0 / RUNS) ** 0.5)


def test_a_gripping_wheel_is_never_reported_as_slipping(runs: list[Run]) -> None:
    """3000 readings at four standard deviations: 0.2 expected outside, so two are too many; the fuser excludes none."""
    assert [event.text for run in runs for event in run.events if event.code == "unit_excluded"] == []
    assert len([event.text for run in runs for event in run.events if event.code in ("wheel_spin", "wheel_slide")]) < 2


def test_spin_and_slide_are_reported_excluded_and_ended(tmp_path: Path) -> None:
    """Both wheels spin by 15 % (12 km/h), then one locks: the fused speed stays within 1 km/h, and the wheels count again."""
    events = [
        {"from_s": 20.0, "to_s": 24.0, "ratio": 0.15, "ramp_s": 1.0},
        {"from_s": 30.0, "to_s": 30.4, "ratio": -1.0, "ramp_s": 0.1, "units": ["odo-1"]},
    ]
    run = Run(tmp_path, {"world": {"seed": 3, "creep": {"events": events}}}, 34.0)
    said = [
        (event.unit, event.code) for event in run.events if event.code.startswith("wheel") and event.code != "wheel_diameter"
    ]
    both = {("odo-1", "wheel_spin"), ("odo-2", "wheel_spin"), ("odo-1", "wheel_grips"), ("odo-2", "wheel_grips")}
    assert set(said[:4]) == both
    assert said[4:] == [("odo-1", "wheel_slide"), ("odo-1", "wheel_grips")]
    assert run.worst_speed_error(10.0, 20.0) < 0.5 / 3.6
    assert run.worst_speed_error(20.0, 34.0) < 1.0 / 3.6
    last = run.states[max(run.states)]
    assert {sensor.unit for sensor in last.sensors} == {"odo-1", "odo-2", "radar-1", "radar-2"}


def test_the_diameter_is_found_and_reported_each_hundred_metres(tmp_path: Path) -> None:
    """Told 810 mm, true 856: after 500 m (22 s) within 0.3 %, as the reports and their deviations say."""
    wheel = {"simulated": {"diameter_m": 0.856, "wear_mps": 5e-6}, "jitter_s": 0.003, "scale_noise_psd": 1e-9}
    run = Run(tmp_path, {"world": {"seed": 5}, "units": {"odo-1": wheel, "odo-2": wheel}}, 30.0)
    reports = [event.text for event in run.events if event.code == "wheel_diameter" and event.unit == "odo-1"]
    at = [float(text.split(" at ")[1].split(" m")[0]) for text in reports]
    assert [round(position / 100.0) for position in at] == list(range(round(at[0] / 100.0), round(at[0] / 100.0) + len(at)))
    by_500 = next(text for text, position in zip(reports, at, strict=True) if position >= 500.0)
    found_mm, std_mm = float(by_500.split(" mm")[0]), float(by_500.split("± ")[1].split(" ")[0])
    assert found_mm == pytest.approx(856.0, rel=0.003)
    assert abs(found_mm - 856.0) < 4.0 * std_mm
    assert std_mm < 1.5
