"""A train that moves harder than its motion model says, again and again: in the end the model is blamed and no sensor."""

from __future__ import annotations

from itertools import groupby
from pathlib import Path

import pytest
import yaml
from harness import ROOT, Journey

from milepost.config.train import load_train
from milepost.offline.run import simulate

pytestmark = pytest.mark.long

DURATION_S = 60.0
# the longest a sensor may be left out: what excludes it, one probation of a second or two, and what the readings take
LONGEST_S = 3.5
WHEEL = {"kind": "odometer", "pulses_per_turn": 200, "diameter_m": 0.9, "scale_std": 0.01}
RADAR = {"kind": "janus_radar", "rate_hz": 10.0, "speed_variance_m2ps2": 0.01}
FAST = {**WHEEL, "rate_hz": 20.0}
FASTER = {**WHEEL, "rate_hz": 50.0, "pulses_per_turn": 60}
TRAINS = {
    "wheel-and-radar": (0.7, {"wheel": {**WHEEL, "rate_hz": 10.0}, "radar": RADAR}),
    "wheels-and-radar": (0.7, {"front": FAST, "rear": {**FAST, "phase_s": 0.02}, "radar": RADAR}),
    "less-sudden": (2.0, {"front": FASTER, "rear": {**FASTER, "phase_s": 0.027}, "radar": RADAR}),
}


def braked(folder: Path, corner_s: float, units: dict[str, object], seed: int) -> Journey:
    """It begins to brake by 0.9 m/s² within `corner_s`; its motion model holds 0.1 m/s² usual in a second."""
    motion = {
        "kind": "white_jerk",
        "start_m": 100.0,
        "profile": [[0.0, 33.0], [15.0, 33.0], [38.0, 12.0], [60.0, 12.0]],
        "corner_s": corner_s,
        "jerk_psd_m2ps5": 1.0e-4,
        "driver_time_s": 40.0,
        "start_std": [0.5, 0.1, 0.0],
    }
    train = {
        "train": "hard",
        "line": str(ROOT / "deploy/lines/metro.yaml"),
        "motion_model": {"jerk_psd_m2ps5": 0.01},
        "prior": {
            "position_m": 100.0,
            "position_std_m": 4.0,
            "speed_mps": 33.0,
            "speed_std_mps": 0.1,
            "acceleration_mps2": 0.0,
            "acceleration_std_mps2": 0.05,
        },
        "fusion": {"rule": "information", "period_ms": 50},
        "world": {"seed": 1, "motion": motion},
        "units": units,
    }
    path = folder / "hard.yaml"
    path.write_text(yaml.safe_dump(train), encoding="utf-8")
    loaded = load_train(path, None, seed)
    journey = Journey(loaded)
    simulate(loaded, DURATION_S, journey.tap, None, None, [])
    return journey


@pytest.mark.parametrize("name", TRAINS)
@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_no_sensor_stays_out_once_the_sensors_agree(tmp_path: Path, name: str, seed: int) -> None:
    """GIVEN honest sensors WHEN the brake was first taken for a sensor's fault THEN that sensor comes back when it agrees."""
    journey = braked(tmp_path, *TRAINS[name], seed)
    states = [state for _, state in sorted(journey.live.items())]
    period_s = journey.train.file.fusion.period_ms / 1000.0
    for unit in TRAINS[name][1]:
        left_out = [any(e.unit == unit for e in state.excluded) for state in states]
        spans = [sum(1 for _ in run) * period_s for out, run in groupby(left_out) if out]
        assert max(spans, default=0.0) <= LONGEST_S, unit
    assert journey.outside() == []
    assert states[-1].status == "normal"
