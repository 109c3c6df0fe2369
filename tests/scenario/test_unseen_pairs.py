"""Two units lie alike, so that an honest one is excluded for a while: what explains that otherwise is not forgotten."""

from __future__ import annotations

from typing import Any

import pytest
from harness import ROOT, Journey, scenario_s
from pydantic import TypeAdapter

from milepost.config.train import load_train
from milepost.offline.run import simulate
from milepost.simulation.faults import FaultEntry


def ride(seed: int, faults: list[dict[str, Any]]) -> Journey:
    """A minute and a half of the full train."""
    train = load_train(ROOT / "deploy/trains/full.yaml", None, seed)
    journey = Journey(train)
    simulate(train, 90.0, journey.tap, None, None, [TypeAdapter(FaultEntry).validate_python(fault) for fault in faults])
    return journey


@pytest.mark.slow
def test_a_wheel_and_a_radar_that_ramp_alike_are_found() -> None:
    """Their pair goes on unheard through the exclusion and readmission of honest units, and is found in the end."""
    ramp = {"kind": "ramp", "rate": 0.01}
    journey = ride(8, [{"unit": "odometer-rear", "from_s": 32.627, **ramp}, {"unit": "radar-front", "from_s": 29.376, **ramp}])
    assert journey.outside() == []
    last = list(journey.live.values())[-1]
    assert {"odometer-rear", "radar-front"} <= {each.unit for each in last.excluded}


@pytest.mark.slow
def test_normal_is_not_said_outside_while_a_radar_and_the_loop_are_late_alike() -> None:
    """With a wheel that spins as well, three lie at once: no row left all of them out, and the interval may be wrong then."""
    behind = {"kind": "clock_step", "by_s": -0.2}
    journey = ride(6, [{"unit": "radar-rear", "from_s": 30.394, **behind}, {"unit": "loop", "from_s": 32.753, **behind}])
    outside = {at_s for at_s, _ in journey.outside()}
    assert not [s for s in journey.live.values() if scenario_s(s) in outside and s.status == "normal"]
