"""Units of a train lie one after another, each while the others are honest; its prior is that of a moving train."""

from __future__ import annotations

from pathlib import Path

import pytest
import yaml
from harness import ROOT, Journey, on_its_line
from pydantic import TypeAdapter

from milepost.config.train import load_train
from milepost.offline.run import simulate
from milepost.simulation.faults import FaultEntry

SPIN = {"unit": "odometer-front", "kind": "spin", "from_s": 15.0, "for_s": 5.0, "ratio": 0.05}
BIASED = {"unit": "radar", "kind": "bias", "from_s": 30.0}
RAMP = {"unit": "odometer-front", "kind": "ramp", "from_s": 15.0, "for_s": 5.0, "rate": 0.1}


def suffered(duration_s: float, *faults: dict[str, object], seed: int = 1, file: Path | None = None) -> Journey:
    train = load_train(file or ROOT / "deploy/trains/regional.yaml", {"fusion": {"period_ms": 100}}, seed)
    journey = Journey(train)
    entries = [TypeAdapter(FaultEntry).validate_python(fault) for fault in faults]
    simulate(train, duration_s, journey.tap, journey.keep, None, entries)
    return journey


def maglev_over_balises(folder: Path) -> Path:
    """The train `maglev` with slower devices and a softer motion model, at 20 m/s on a line with a balise each 100 m."""
    balises = {"every_m": 100.0, "from_m": 50.0, "location_accuracy_m": 0.05}
    line = {"line": "balises", "length_m": 9000.0, "map_accuracy_m": 0.02, "balises": balises}
    train = yaml.safe_load((ROOT / "deploy/trains/maglev.yaml").read_text(encoding="utf-8"))
    train["motion_model"] = {"jerk_psd_m2ps5": 0.01}
    train["prior"] |= {"position_std_m": 2.0, "acceleration_std_mps2": 0.05}
    train["world"]["motion"] |= {"profile": [[0.0, 20.0]], "corner_s": 5.0}
    train["units"]["radar"] |= {"rate_hz": 20.0, "scale_std": 0.0}
    train["units"]["loop"]["rate_hz"] = 20.0
    return on_its_line(folder, line, train)


@pytest.mark.parametrize("size", [0.25, 0.3, 0.35])
@pytest.mark.parametrize("seed", [1, 2])
def test_a_row_that_began_later_than_the_first_does_not_take_the_way_in_between_for_a_diameter(size: float, seed: int) -> None:
    """GIVEN wheels heard up to 0.1 s later than the radar, WHEN the radar lies 30 s later, THEN the wheels' row holds."""
    assert suffered(45.0, SPIN, {**BIASED, "size": size}, seed=seed).outside() == []


@pytest.mark.parametrize("seed", [1, 2, 3, 4, 5, 6])
def test_a_wheel_that_learned_from_its_own_slow_lie_comes_back(seed: int) -> None:
    """GIVEN a lie so slow that the wheel's diameter learns it, WHEN it ends, THEN that is forgotten after half a minute."""
    journey = suffered(65.0, RAMP, seed=seed)
    states = [state for _, state in sorted(journey.live.items())]
    assert any(e.unit == "odometer-front" for state in states for e in state.excluded)
    assert states[-1].excluded == []
    assert states[-1].status == "normal"
    assert journey.outside() == []


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_who_lied_before_is_not_blamed_for_good(tmp_path: Path, seed: int) -> None:
    """GIVEN a radar that lied and healed WHEN the loop lies THEN it is found once balises refute the radar's."""
    lied = {"unit": "radar", "kind": "bias", "from_s": 10.0, "for_s": 4.0, "size": 1.0}
    lies = {"unit": "loop", "kind": "bias", "from_s": 25.0, "size": 0.3}
    journey = suffered(100.0, lied, lies, seed=seed, file=maglev_over_balises(tmp_path))
    last = max(journey.live.items())[1]
    assert {e.unit for e in last.excluded} == {"loop"}
    assert journey.outside() == []
