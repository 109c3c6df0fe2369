"""After a long coast one unit's word does not narrow the protected interval; a second unit that agrees does."""

from __future__ import annotations

from functools import cache
from typing import Any

import pytest
from harness import ROOT, Journey
from pydantic import TypeAdapter

from milepost.config.train import load_train
from milepost.offline.run import simulate
from milepost.simulation.faults import FaultEntry
from milepost_schemas import FusedState

pytestmark = pytest.mark.long

SILENT_S, BACK_S, SECOND_S, END_S = 12.0, 32.0, 40.0, 48.0

HONEST: dict[str, Any] | None = None
JUMP = {"kind": "jump", "size": 50.0}
BIAS_MPS = 3.0
BIAS = {"kind": "bias", "size": BIAS_MPS}
# (unit that is back first, how it lies, unit that is back second)
CASES: list[tuple[str, dict[str, Any] | None, str]] = [
    ("gnss", HONEST, "radar-front"),
    ("gnss", JUMP, "radar-front"),
    ("radar-rear", BIAS, "radar-front"),
]
each_case = pytest.mark.parametrize(("first", "lie", "second"), CASES, ids=["gnss", "gnss lies", "radar lies"])


def coasted(first: str, lie: dict[str, Any] | None, second: str) -> Journey:
    """The full train: every unit falls silent, one is heard again after 20 s, another after 28 s."""
    return _coasted(first, tuple((lie or {}).items()), second)


@cache
def _coasted(first: str, lie: tuple[tuple[str, Any], ...], second: str) -> Journey:
    train = load_train(ROOT / "deploy/trains/full.yaml")
    back_s = {first: BACK_S, second: SECOND_S}
    faults: list[dict[str, Any]] = []
    for unit, sensor in train.sensors.items():
        kind = "missed_balise" if sensor.kind == "balise_reader" else "drop_out"
        until = {"for_s": back_s[unit] - SILENT_S} if unit in back_s else {}
        faults.append({"unit": unit, "kind": kind, "from_s": SILENT_S, **until})
    if lie:
        faults.append({"unit": first, "from_s": BACK_S, **dict(lie)})
    journey = Journey(train)
    simulate(train, END_S, journey.tap, None, None, [TypeAdapter(FaultEntry).validate_python(fault) for fault in faults])
    return journey


def half_width_mps(state: FusedState) -> float:
    return 0.5 * (state.speed_max_mps - state.speed_min_mps)


@each_case
def test_the_truth_stays_inside(first: str, lie: dict[str, Any] | None, second: str) -> None:
    assert coasted(first, lie, second).outside() == []


@each_case
def test_one_unit_alone_leaves_the_train_lost(first: str, lie: dict[str, Any] | None, second: str) -> None:
    """GIVEN a long coast WHEN one unit is heard again, honest or not, THEN the status and the interval do not believe it."""
    alone = coasted(first, lie, second).between(BACK_S + 1.0, SECOND_S)
    assert {state.status for state in alone} == {"lost"}
    assert min(half_width_mps(state) for state in alone) > 20.0


def test_a_second_unit_that_agrees_gives_the_speed_back() -> None:
    states = coasted("gnss", HONEST, "radar-front").between(SECOND_S + 2.0, END_S)
    assert max(half_width_mps(state) for state in states) < 1.0


def test_a_second_unit_that_contradicts_is_held_beside_the_first() -> None:
    """GIVEN a liar alone WHEN the honest unit is heard THEN both are doubted, and the interval holds what both say."""
    journey = coasted("radar-rear", BIAS, "radar-front")
    states = journey.between(SECOND_S + 2.0, END_S)
    assert {tuple(state.doubted) for state in states} == {("radar-front", "radar-rear")}
    for state in states:
        true_mps = journey.truth[state.measured_at_ns].speed_mps
        assert state.speed_min_mps <= true_mps
        assert state.speed_max_mps >= true_mps + BIAS_MPS - 1.0
