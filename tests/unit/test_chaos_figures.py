"""What the chaos suite measures of a stretch of states, computed by hand."""

from __future__ import annotations

from typing import Any

import pytest

from examples import EXAMPLES, head
from milepost.chaos.cells import Cell
from milepost.chaos.figures import measure
from milepost.chaos.matrix import judged
from milepost.chaos.view import View
from milepost_schemas import FusedState, Truth

MS = 1_000_000
CELL = Cell("a process", "killed", lambda stack: None, 1.0)
T0 = 1_700_000_000_000 * MS


def at(ms: float) -> int:
    return T0 + round(ms * MS)


def state(k: int, position: float = 100.0) -> FusedState:
    """The state of the k-th epoch, with an interval of ±2 m and ±1 m/s about 20 m/s."""
    changes: dict[str, Any] = {
        **head("fuser", measured_at_ns=at(20 * k), sequence=k),
        "epoch": k,
        "position_m": position,
        "position_min_m": position - 2.0,
        "position_max_m": position + 2.0,
        "speed_mps": 20.0,
        "speed_min_mps": 19.0,
        "speed_max_mps": 21.0,
    }
    return FusedState.model_validate({**EXAMPLES["state"][0].model_dump(), **changes})


def truth(k: int, position: float, speed: float = 20.0) -> Truth:
    return Truth(**head("world", measured_at_ns=at(20 * k)), position_m=position, speed_mps=speed, acceleration_mps2=0.0)


def test_a_gap_lasts_until_a_later_epoch_and_the_last_one_until_the_end() -> None:
    received = [(at(5), state(0)), (at(25), state(1)), (at(65), state(1)), (at(105), state(4))]
    found = measure(received, {}, [], at(110))
    assert found.gap_s == pytest.approx(0.080), "an epoch that is repeated ends no gap"
    assert (found.repeated, found.missing) == (1, 2)
    assert measure(received, {}, [], at(305)).gap_s == pytest.approx(0.200), "states that stopped are a gap too"


def test_a_stall_of_the_machine_is_told_apart_by_its_part_in_the_gap() -> None:
    received = [(at(0), state(0)), (at(100), state(5)), (at(170), state(8))]
    found = measure(received, {}, [(at(-40), at(60))], at(180))
    assert (found.gap_s, found.stall_s) == (pytest.approx(0.070), 0.0), "the gap that is longest without the stall"
    found = measure(received[:2], {}, [(at(-40), at(60))], at(110))
    assert (found.gap_s, found.stall_s, found.own_gap_s) == pytest.approx((0.100, 0.060, 0.040))


def test_a_truth_outside_either_interval_is_a_violation() -> None:
    truths = {t.measured_at_ns: t for t in (truth(0, 101.9), truth(1, 102.1), truth(2, 100.0, 21.5))}
    found = measure([(at(20 * k + 5), state(k)) for k in range(4)], truths, [], at(90))
    assert (found.compared, found.violations) == (3, 2)
    assert found.error_m == pytest.approx(2.1)


@pytest.mark.parametrize(
    ("first", "again", "awaiting", "contradicted"),
    [(100.0, 100.0, [], 0), (100.0, 101.9, [], 0), (100.0, 102.1, [], 1), (100.0, 102.1, ["radar"], 0)],
)
def test_an_epoch_may_be_said_twice_but_not_contradicted(
    first: float, again: float, awaiting: list[str], contradicted: int
) -> None:
    """Of two fusers one may have heard more; what it says must still be within what the other one says."""
    received = [
        (at(5), state(0, first).model_copy(update={"awaiting": awaiting})),
        (at(6), state(0, again).model_copy(update={"awaiting": []})),
    ]
    found = measure(received, {}, [], at(10))
    assert (found.repeated, found.contradicted) == (1, contradicted)
    assert any("contradict" in each for each in judged(CELL, found)) == bool(contradicted)


def test_a_process_that_is_none_is_one_sentence() -> None:
    view = View()
    view.name, view.jobs = "full", {"fuser": None, "sensor-gnss": None}  # type: ignore[dict-item]
    with pytest.raises(LookupError, match=r"^full has no process 'fusser'; did you mean 'fuser'\?; it has fuser, sensor-gnss$"):
        view.pid("fusser")


def test_nothing_received_is_no_figure() -> None:
    assert measure([], {}, [], at(0)).states == 0
