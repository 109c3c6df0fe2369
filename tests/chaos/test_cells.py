"""A short selection of the matrix of `milepost chaos`, on one train: the truth stays inside, and the train is well again.

`make chaos` measures the gaps against their limits; here they are wider, because other work may share the machine.
"""

from __future__ import annotations

import gc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest

from milepost.chaos.matrix import planned, run_cell
from milepost.chaos.stack import NORMAL_S, Stack
from milepost.chaos.text import row

pytestmark = [pytest.mark.system, pytest.mark.long]
SELECTION = (
    "fuser that leads killed",
    "fuser that leads stopped 2 s",
    "router in use killed",
    "router in use stopped 2 s",
    "sensor-radar-front killed",
    "filter-loop stopped 2 s",
    "balise replaced",
    "gnss jump, fuser that leads killed",
)
# what other work on the machine may add to a gap
SHARED_S = 1.0
FULL = Path("deploy/trains/full.yaml")
CELLS = {cell.name: cell for cell in planned(FULL, ())}


@pytest.fixture(scope="module")
def train() -> Iterator[Stack]:
    """One train for all cells."""
    with Stack(FULL) as stack:
        yield stack


@pytest.mark.parametrize("name", SELECTION)
def test_the_truth_stays_inside_and_the_train_recovers(train: Stack, name: str) -> None:
    train.recovered(NORMAL_S)
    cell = CELLS[name]
    outcome = run_cell(train, replace(cell, gap_s=cell.gap_s + SHARED_S))
    assert outcome.passed, row(outcome)


def test_who_measures_gaps_makes_none(train: Stack) -> None:
    """A search for cycles among all the messages of a long run holds up the receipt of states for tenths of a second."""
    searched: list[str] = []

    def note(phase: str, info: dict[str, int]) -> None:
        searched.append(f"{phase} of generation {info['generation']}")

    gc.callbacks.append(note)
    try:
        kept = [[i] for i in range(100_000)]
    finally:
        gc.callbacks.remove(note)
    assert (len(kept), searched) == (100_000, [])
    assert train.witness.received
