"""A recorded run of false RTK, 7.6 s beside the track: the fuser's hypotheses against the receiver's own word."""

from __future__ import annotations

from typing import Any

import pytest
from harness import ROOT, Journey, at, travel

from milepost.recordings.gnss_log import with_default_columns

pytestmark = pytest.mark.long

LOG = ROOT.parent / "shared/data/brussels/log_31259_gnss.csv"
# scenario time 0 in the log: twenty seconds before the first of its two runs of false RTK
FROM_S = 260.0
FALSE_S = (427.6 - FROM_S, 435.2 - FROM_S)
END_S = 476.0 - FROM_S
FROM_THERE: dict[str, Any] = {
    "prior": {"position_m": 3075.0, "speed_mps": 14.0},
    "world": {
        "motion": {
            "gnss_log": {**with_default_columns(LOG), "shift_s": -FROM_S},
            "untrusted_s": [[279.0 - FROM_S, 300.0 - FROM_S], [427.0 - FROM_S, 440.0 - FROM_S]],
        }
    },
    "units": {"gnss": {"recording": {**with_default_columns(LOG), "shift_s": -FROM_S}}},
}
# a monitor that lets everything pass that calls itself RTK
CREDULOUS: dict[str, Any] = FROM_THERE | {
    "units": {
        "gnss": {
            **FROM_THERE["units"]["gnss"],
            "cross_track_limit_m": 10000.0,
            "monitor": {"coasting_s": 10000.0, "jump_sigmas": 10000.0, "max_acceleration_mps2": 10000.0},
        }
    }
}


@pytest.fixture(scope="module", params=["monitored", "credulous"])
def journey(request: pytest.FixtureRequest) -> Journey:
    if not LOG.is_file():
        pytest.skip("the recorded logs are not here")
    change = CREDULOUS if request.param == "credulous" else FROM_THERE
    return travel(END_S, change=change, train_file=ROOT / "deploy/trains/brussels-31259.yaml")


def test_the_truth_stays_inside_throughout(journey: Journey) -> None:
    assert journey.outside() == []


def test_the_receiver_is_excluded_while_its_rtk_is_false(journey: Journey) -> None:
    doubted = journey.between(FALSE_S[0] + 0.1, FALSE_S[1])
    assert all("gnss" in {*state.doubted, *(e.unit for e in state.excluded)} for state in doubted)
    during = journey.between(FALSE_S[0] + 1.5, FALSE_S[1])
    assert all(any(e.unit == "gnss" for e in state.excluded) for state in during)


def test_no_false_fix_moves_the_state(journey: Journey) -> None:
    errors = [abs(s.position_m - journey.truth[s.measured_at_ns].position_m) for s in journey.between(*FALSE_S)]
    assert max(errors) < 0.1


def test_the_receiver_counts_again_afterwards(journey: Journey) -> None:
    assert "gnss" in {unit.unit for unit in journey.live[at(END_S - 6.0)].sensors}


def test_nobody_else_is_excluded(journey: Journey) -> None:
    assert {e.unit for state in journey.between(2.0, END_S) for e in state.excluded} == {"gnss"}
