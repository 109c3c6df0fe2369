"""The rates that a train file sets, by what paces each stream."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from examples import write_train
from milepost.config.rates import expected_hz
from milepost.config.roles import ROLES, Setting, processes
from milepost.config.train import Train, load_train
from milepost_schemas import BY_NAME

FULL = Path(__file__).resolve().parents[2] / "deploy" / "trains" / "full.yaml"


def rates(train: Train) -> dict[str, dict[str, float]]:
    setting = Setting("i", train.world(10.0))
    return {
        process.name: expected_hz(
            train, ROLES[process.role], process.unit, ROLES[process.role].build(train, process.unit, setting)
        )
        for process in processes(train)
    }


def test_the_default_trains_rates_are_those_of_its_units_and_epochs() -> None:
    found = rates(load_train(FULL))
    assert found["sensor-radar-front"] == pytest.approx({"speed_reading": 20.0})
    assert found["filter-gnss"] == pytest.approx({"position_reading": 5.0, "estimate": 5.0})
    assert found["filter-imu"] == pytest.approx({"inertial_reading": 20.0, "estimate": 20.0})
    # two radars and the inertial unit at 20 Hz, the receiver at 5; wheels and loop speak as pulses come
    assert found["fuser"] == pytest.approx({"estimate": 65.0, "state": 50.0, "feedback": 50.0, "hypotheses": 1.0})
    assert found["world"] == pytest.approx({"truth": 50.0})


def test_streams_paced_by_events_have_no_rate() -> None:
    found = rates(load_train(FULL))
    assert found["sensor-balise-reader"] == found["filter-loop"] == {}
    # feedback wakes the balise service
    assert found["balise"] == {"feedback": 50.0}


@pytest.mark.parametrize(
    ("fusion", "state", "feedback"),
    [({"period_ms": 100}, 10.0, 10.0), ({"feedback_every": 5}, 50.0, 10.0), ({"feedback": False}, 50.0, None)],
    ids=["period", "feedback less often", "no feedback"],
)
def test_epochs_and_feedback_follow_the_train_file(
    tmp_path: Path, fusion: dict[str, Any], state: float, feedback: float | None
) -> None:
    found = rates(load_train(write_train(tmp_path, {f"fusion.{name}": value for name, value in fusion.items()})))["fuser"]
    assert (found["state"], found.get("feedback")) == (state, feedback)


def test_a_train_sends_only_the_streams_of_its_roles() -> None:
    train = load_train(FULL)
    sent = {name for process in processes(train) for name in ROLES[process.role].sends(train, process.unit)}
    # commands come from a tool, candidates from fusers that are voted on, position reports from a train that is told to
    assert sent == set(BY_NAME) - {"event", "health", "chaos", "candidate", "position_report"}
