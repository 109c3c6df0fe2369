"""Units of a regional train lie one after another, each while the others are honest; its prior is that of a moving train."""

from __future__ import annotations

import pytest
from harness import ROOT, Journey
from pydantic import TypeAdapter

from milepost.config.train import load_train
from milepost.offline.run import simulate
from milepost.simulation.faults import FaultEntry

SPIN = {"unit": "odometer-front", "kind": "spin", "from_s": 15.0, "for_s": 5.0, "ratio": 0.05}
BIASED = {"unit": "radar", "kind": "bias", "from_s": 30.0}
RAMP = {"unit": "odometer-front", "kind": "ramp", "from_s": 15.0, "for_s": 5.0, "rate": 0.1}


def suffered(duration_s: float, *faults: dict[str, object], seed: int = 1) -> Journey:
    train = load_train(ROOT / "deploy/trains/regional.yaml", {"fusion": {"period_ms": 100}}, seed)
    journey = Journey(train)
    entries = [TypeAdapter(FaultEntry).validate_python(fault) for fault in faults]
    simulate(train, duration_s, journey.tap, None, None, entries)
    return journey


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
