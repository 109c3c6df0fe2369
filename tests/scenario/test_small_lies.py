"""A radar whose scale is off by half a percent: too little to be seen, and carried on by what the wheels learn from it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
import yaml
from harness import ROOT, Journey
from pydantic import TypeAdapter

from milepost.config.train import load_train
from milepost.offline.run import simulate
from milepost.simulation.faults import FaultEntry

WHEEL = {"kind": "odometer", "rate_hz": 10.0, "pulses_per_turn": 100, "diameter_m": 0.85, "scale_std": 0.06}
RADAR = {"kind": "janus_radar", "rate_hz": 10.0, "speed_variance_m2ps2": 0.04}
PRIOR = {"position_m": 100.0, "speed_mps": 22.0, "acceleration_mps2": 0.0}
STD = {"position_std_m": 0.5, "speed_std_mps": 0.1, "acceleration_std_mps2": 0.05}
MOTION = {
    "kind": "white_jerk",
    "start_m": 100.0,
    "profile": [[0.0, 22.0]],
    "corner_s": 4.0,
    "jerk_psd_m2ps5": 1.0e-5,
    "driver_time_s": 40.0,
    "start_std": [0.5, 0.1, 0.0],
}


def ride(
    folder: Path, seed: int, duration_s: float, units: dict[str, Any], jerk_psd: float = 0.01, std: float = 0.06, **world: Any
) -> Journey:
    """A train with two wheels and a radar that reads 0.6 % more from 5 s on."""
    wheels = {"o1": {**WHEEL, "scale_std": std, "phase_s": 0.0}, "o2": {**WHEEL, "scale_std": std, "phase_s": 0.05}}
    train = {
        "train": "small-lies",
        "line": str(ROOT / "deploy/lines/metro.yaml"),
        "motion_model": {"jerk_psd_m2ps5": jerk_psd},
        "prior": PRIOR | STD,
        "fusion": {"rule": "information", "period_ms": 100, "shares": "by_accuracy"},
        "world": {"seed": 1, "motion": MOTION, **world},
        "units": {**wheels, "radar": RADAR, **units},
    }
    path = folder / "small-lies.yaml"
    path.write_text(yaml.safe_dump(train), encoding="utf-8")
    loaded = load_train(path, None, seed)
    journey = Journey(loaded)
    lie = {"unit": "radar", "kind": "scale", "factor": 1.006, "from_s": 5.0}
    simulate(loaded, duration_s, journey.tap, None, None, [TypeAdapter(FaultEntry).validate_python(lie)])
    return journey


@pytest.mark.slow
@pytest.mark.parametrize("seed", [4, 5, 6])
def test_a_wheel_that_slipped_does_not_bring_what_a_liar_has_taught_it_to_the_rows_without_the_liar(
    tmp_path: Path, seed: int
) -> None:
    slip = {"events": [{"from_s": 60.0, "to_s": 61.5, "ratio": 0.2, "units": ["o1"]}]}
    journey = ride(tmp_path, seed, 110.0, {}, creep=slip)
    assert journey.outside() == []


@pytest.mark.slow
@pytest.mark.parametrize("seed", [1, 3, 4])
def test_a_brake_harder_than_the_motion_model_does_not_hide_that_the_radar_may_lie_too(tmp_path: Path, seed: int) -> None:
    """GIVEN a lie that nobody has seen WHEN the train brakes by 1.3 m/s² THEN both causes together stay in the interval."""
    brakes = {**MOTION, "profile": [[0.0, 22.0], [60.0, 22.0], [70.0, 9.0], [200.0, 9.0]]}
    journey = ride(tmp_path, seed, 90.0, {"imu": {"kind": "imu", "rate_hz": 10.0}}, 0.001, 0.01, motion=brakes)
    assert journey.outside() == []
