"""A short selection of the matrix of `milepost chaos`, on one train: each cell keeps its limits."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

from milepost.chaos.matrix import planned, run_cell
from milepost.chaos.stack import NORMAL_S, Stack
from milepost.chaos.text import row

pytestmark = pytest.mark.system
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
FULL = Path("deploy/trains/full.yaml")
CELLS = {cell.name: cell for cell in planned(FULL, ())}


@pytest.fixture(scope="module")
def train() -> Iterator[Stack]:
    """One train for all cells."""
    with Stack(FULL) as stack:
        yield stack


@pytest.mark.parametrize("name", SELECTION)
def test_a_cell_keeps_its_limits(train: Stack, name: str) -> None:
    train.recovered(NORMAL_S)
    outcome = run_cell(train, CELLS[name])
    assert outcome.passed, row(outcome)
