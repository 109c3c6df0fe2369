"""An inertial unit whose sign is swapped: it is right while the train keeps its speed, and wrong whenever that changes."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from harness import ROOT, Journey, on_its_line
from pydantic import TypeAdapter

from milepost.config.train import load_train
from milepost.offline.run import simulate
from milepost.simulation.faults import FaultEntry

SWAPPED = TypeAdapter(FaultEntry).validate_python({"unit": "imu", "kind": "scale", "from_s": 20.0, "factor": -1.0})
# the train brakes from 30 to 50 s and accelerates from 60 to 75 s
PROFILE = [[0.0, 25.0], [30.0, 25.0], [50.0, 5.0], [60.0, 5.0], [75.0, 12.0]]


@pytest.fixture
def with_inertial_unit(tmp_path: Path) -> Path:
    """The train `regional` with an inertial unit, on a line with a balise each 100 m."""
    balises = {"every_m": 100.0, "from_m": 150.0, "location_accuracy_m": 0.05}
    line = {"line": "balises", "length_m": 9000.0, "map_accuracy_m": 0.02, "balises": balises}
    train = yaml.safe_load((ROOT / "deploy/trains/regional.yaml").read_text(encoding="utf-8"))
    del train["etcs"]
    train["motion_model"] = {"jerk_psd_m2ps5": 0.4}
    train["prior"]["speed_mps"] = 25.0
    train["world"]["motion"] |= {"profile": PROFILE, "corner_s": 2.5, "jerk_psd_m2ps5": 1e-3}
    train["units"]["imu"] = {"kind": "imu", "rate_hz": 20.0}
    return on_its_line(tmp_path, line, train)


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5, 6])
def test_a_swapped_sign_makes_no_train_lost_that_passes_balises(with_inertial_unit: Path, seed: int) -> None:
    """GIVEN a swapped sign WHEN the train brakes and accelerates THEN the others and the balises tell where it is.

    That all others lie instead, from two causes, is possible until a balise contradicts it. When the inertial unit is wrong
    again, they may have begun to lie when it was readmitted, no earlier: the interval is not that of a train without sensors.
    """
    journey = Journey(load_train(with_inertial_unit, {"fusion": {"period_ms": 100}}, seed))
    simulate(journey.train, 90.0, journey.tap, journey.keep, None, [SWAPPED])
    assert journey.outside() == []
    states = [state for _, state in sorted(journey.live.items())]
    assert "lost" not in {state.status for state in states}
    assert {unit.unit for state in states for unit in state.excluded if unit.kind != "silent"} == {"imu"}
