"""A recorded run of false RTK, 7.6 s beside the track: the fuser's hypotheses against the receiver's own word."""

from __future__ import annotations

from typing import Any

import pytest
from harness import ROOT, Journey, at, travel

LOG = ROOT.parent / "shared/data/brussels/log_31259_gnss.csv"
FALSE_S = (427.6, 435.2)
# a monitor that lets everything pass that calls itself RTK
CREDULOUS: dict[str, Any] = {
    "units": {
        "gnss": {
            "cross_track_limit_m": 10000.0,
            "monitor": {"coasting_s": 10000.0, "jump_sigmas": 10000.0, "max_acceleration_mps2": 10000.0},
        }
    }
}


@pytest.fixture(scope="module", params=["monitored", "credulous"])
def journey(request: pytest.FixtureRequest) -> Journey:
    if not LOG.is_file():
        pytest.skip("the recorded logs are not here")
    change = CREDULOUS if request.param == "credulous" else {}
    return travel(476.0, change=change, train_file=ROOT / "deploy/trains/brussels-31259.yaml")


def test_the_truth_stays_inside_throughout(journey: Journey) -> None:
    assert journey.outside() == []


def test_the_receiver_is_excluded_while_its_rtk_is_false(journey: Journey) -> None:
    during = journey.between(FALSE_S[0] + 1.0, FALSE_S[1])
    assert all(any(e.unit == "gnss" for e in state.excluded) for state in during)


def test_no_false_fix_moves_the_state(journey: Journey) -> None:
    errors = [abs(s.position_m - journey.truth[s.measured_at_ns].position_m) for s in journey.between(*FALSE_S)]
    assert max(errors) < 0.1


def test_the_receiver_counts_again_afterwards(journey: Journey) -> None:
    assert "gnss" in {unit.unit for unit in journey.live[at(470.0)].sensors}


def test_nobody_else_is_excluded(journey: Journey) -> None:
    assert {e.unit for state in journey.between(2.0, 476.0) for e in state.excluded} == {"gnss"}
