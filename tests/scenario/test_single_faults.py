"""One sensor lies: the truth stays inside, the liar is excluded in time, and nobody else is."""

from __future__ import annotations

from typing import Any

import pytest
from harness import ROOT, Journey, scenario_s
from pydantic import TypeAdapter

from milepost.config.train import load_train
from milepost.offline.run import simulate
from milepost.simulation.faults import FaultEntry

ONSET_S = 20.0
# (train, unit, fault, excluded within seconds); None: what it says is too near the truth to be found
CELLS: list[tuple[str, str, dict[str, Any], float | None]] = [
    ("maglev", "radar", {"kind": "bias", "size": 1.0}, 1.0),
    ("maglev", "radar", {"kind": "bias", "size": 0.2}, 2.0),
    ("maglev", "radar", {"kind": "stuck"}, 2.0),
    ("maglev", "loop", {"kind": "scale", "factor": 1.03}, 1.0),
    ("maglev", "loop", {"kind": "noise", "factor": 10.0}, 1.0),
    ("metro", "radar-1", {"kind": "bias", "size": 1.0}, 1.0),
    ("metro", "radar-1", {"kind": "stuck"}, 2.0),
    ("metro", "odometer-1", {"kind": "bias", "size": 1.0}, 1.0),
    ("full", "gnss", {"kind": "jump", "size": 50.0}, 1.0),
    ("full", "imu", {"kind": "bias", "size": 0.2}, 10.0),
    ("full", "radar-front", {"kind": "scale", "factor": 1.03}, 1.0),
    ("maglev", "balise-reader", {"kind": "late_stamp", "by_s": 0.05}, None),
    ("metro", "balise-reader", {"kind": "late_stamp", "by_s": 0.05}, None),
]


def ride(train_name: str, unit: str, fault: dict[str, Any], from_s: float = ONSET_S) -> Journey:
    """Half a minute on one seed, with one fault from `from_s` on."""
    train = load_train(ROOT / f"deploy/trains/{train_name}.yaml")
    journey = Journey(train)
    entry = TypeAdapter(FaultEntry).validate_python({"unit": unit, "from_s": from_s, **fault})
    simulate(train, 35.0, journey.tap, None, None, [entry])
    return journey


@pytest.mark.parametrize(("train", "unit", "fault", "within_s"), CELLS, ids=lambda cell: str(cell))
def test_a_liar_is_excluded_and_the_truth_stays_inside(
    train: str, unit: str, fault: dict[str, Any], within_s: float | None
) -> None:
    journey = ride(train, unit, fault)
    assert journey.outside() == []
    after = [state for state in journey.live.values() if scenario_s(state) >= ONSET_S]
    assert {e.unit for state in after for e in state.excluded} <= {unit}
    if within_s is not None:
        found = [scenario_s(state) for state in after if any(e.unit == unit for e in state.excluded)]
        assert found[0] - ONSET_S <= within_s


@pytest.mark.parametrize(("train", "unit"), [("metro", "radar-1"), ("full", "gnss"), ("maglev", "radar")])
def test_a_clock_that_is_behind_from_the_start_moves_no_other_units_prior(train: str, unit: str) -> None:
    """The prior sits at the first reading: half a second too early, it would carry all hypotheses ten metres off."""
    assert ride(train, unit, {"kind": "clock_step", "by_s": -0.5}, from_s=0.0).outside() == []
