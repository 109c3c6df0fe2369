"""Faults of sensors on the memory bus: what leaves the sensor's process is what everything behind it gets."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import pytest

from milepost.config.roles import ROLES, Setting
from milepost.config.train import Train, load_train
from milepost.config.yaml_files import ConfigError
from milepost.evaluation.plan import make_plan
from milepost.evaluation.scenario_run import run_plan
from milepost.nodes.base import Output
from milepost.offline.run import OFFLINE_START_NS, simulate
from milepost.simulation.faults import FAULTS, FaultEntry
from milepost_schemas import Message, SpeedReading

ROOT = Path(__file__).resolve().parents[2]
MAGLEV = load_train(ROOT / "deploy/trains/maglev.yaml")
FULL = load_train(ROOT / "deploy/trains/full.yaml")
# where a kind needs options
OPTIONS: dict[str, dict[str, Any]] = {
    "bias": {"size": 1.0},
    "ramp": {"rate": 1.0},
    "scale": {"factor": 1.1},
    "noise": {"factor": 10.0},
    "intermittent": {"size": 1.0},
    "jump": {"size": 50.0},
    "delay": {"by_s": 0.2},
    "clock_step": {"by_s": -0.2},
    "clock_drift": {"ppm": -500.0},
    "late_stamp": {"by_s": 0.2},
    "spin": {"ratio": 0.2},
    "slide": {"ratio": -0.2},
    "drag": {"rate_mps": 1.0},
    "moved_balise": {"offset_m": 10.0},
    # with the same stamps a filter knows the copies
    "duplicate": {"offset_ms": 0.5},
}
CASES = [
    (kind, train, unit)
    for kind, row in FAULTS.items()
    for stream in row.streams
    for train, unit in [
        next(
            (train, unit)
            for train in (MAGLEV, FULL)
            for unit, sensor in train.sensors.items()
            if sensor.stream == stream and (not row.sensors or sensor.kind in row.sensors)
        )
    ]
]


def sent(unit: str, *faults: FaultEntry, duration_s: float = 2.0) -> list[Message]:
    """The readings of a unit of the maglev train as they leave its process."""
    out: list[Message] = []

    def tap(output: Output, now_ns: int) -> None:
        if output.unit == unit and output.stream == MAGLEV.sensors[unit].stream:
            out.append(output.message)

    simulate(MAGLEV, duration_s, tap, faults=faults)
    return out


def onset_s(train: Train, unit: str) -> float:
    """When a fault begins; the train passes a balise every 5 s."""
    return 6.0 if unit in train.balise_readers else 2.0


def inbox(train: Train, unit: str, *faults: FaultEntry) -> list[tuple[int, Message]]:
    """What the fuser gets that is of a unit's readings, with the time of receipt."""
    fuser = ROLES["fuser"].build(train, "fuser", Setting("offline"))
    streams = {subscription.stream for subscription in fuser.subscriptions}
    sender = "balise" if unit in train.balise_readers else unit
    got: list[tuple[int, Message]] = []

    def tap(output: Output, now_ns: int) -> None:
        if output.stream in streams and output.unit == sender:
            got.append((now_ns, output.message))

    simulate(train, onset_s(train, unit) + (5.0 if sender == "balise" else 1.0), tap, faults=faults)
    return got


@cache
def honest_inbox(train_name: str, unit: str) -> list[tuple[int, Message]]:
    return inbox({train.name: train for train in (MAGLEV, FULL)}[train_name], unit)


@pytest.mark.long
@pytest.mark.parametrize(("kind", "train", "unit"), CASES, ids=lambda case: case if isinstance(case, str) else case.name)
def test_a_fault_reaches_the_fuser_from_its_onset_on(kind: str, train: Train, unit: str) -> None:
    from_s = onset_s(train, unit)
    fault = FaultEntry.model_validate({"unit": unit, "kind": kind, "from_s": from_s, **OPTIONS.get(kind, {})})
    honest, lying = honest_inbox(train.name, unit), inbox(train, unit, fault)
    onset_ns = OFFLINE_START_NS + round(from_s * 1e9)
    # what was measured before the onset may be on its way for a while
    assert [m for at, m in honest if at < onset_ns] == [m for at, m in lying if at < onset_ns] != []
    assert [m for at, m in honest if at >= onset_ns] != [m for at, m in lying if at >= onset_ns]


def test_a_bias_acts_on_its_unit_in_its_span() -> None:
    honest = sent("radar")
    lying = sent("radar", FaultEntry(unit="radar", kind="bias", from_s=0.5, for_s=1.0, size=0.25))
    assert len(honest) == len(lying) > 100
    for before, after in zip(honest, lying, strict=True):
        assert isinstance(before, SpeedReading)
        on = 0.5 <= (before.measured_at_ns - OFFLINE_START_NS) * 1e-9 < 1.5
        assert before.speed_mps is not None
        assert after == before.model_copy(update={"speed_mps": before.speed_mps + (0.25 if on else 0.0)})


def test_a_fault_of_a_unit_that_is_not_there_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"maglev.yaml: faults.0.unit: .*did you mean 'radar'"):
        sent("radar", FaultEntry(unit="radr", kind="stuck", from_s=0.0))


def test_a_fault_that_does_not_fit_the_unit_is_refused() -> None:
    with pytest.raises(ConfigError, match=r"faults.0.kind: radar: jump does not fit speed_reading, but position_reading"):
        sent("radar", FaultEntry(unit="radar", kind="jump", from_s=0.0, size=5.0))


def test_variants_and_estimators_may_have_faults_of_their_own(tmp_path: Path) -> None:
    fault: dict[str, Any] = {"unit": "loop", "kind": "bias", "from_s": 0.0, "size": 5.0}
    fields = {
        "scenario": "lies",
        "train": str(ROOT / "deploy/trains/maglev.yaml"),
        "duration_s": 3.0,
        "compare": ["fused"],
        "faults": [fault],
        "estimators": {"healthy": {"faults": []}, "with_them": {}},
        "variants": {"none": {"faults": []}},
    }
    path = tmp_path / "lies.yaml"
    path.write_text(json.dumps(fields), encoding="utf-8")
    result = run_plan(make_plan(path), None, lambda t_s: None).result
    own, none = result["estimators"], result["variants"]["none"]["estimators"]
    assert own["healthy"]["position_max_m"] == none["healthy"]["position_max_m"] == none["with_them"]["position_max_m"]
    # the liar is excluded, so that it shows in the accuracy lost without it
    assert own["fused"]["position_max_m"] != none["fused"]["position_max_m"]
    assert own["with_them"]["position_max_m"] != own["healthy"]["position_max_m"]
