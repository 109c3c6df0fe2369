"""The matrix as Markdown."""

from __future__ import annotations

from milepost.chaos.cells import Cell
from milepost.chaos.figures import Figures
from milepost.chaos.grid import tables
from milepost.chaos.matrix import Outcome


def outcome(hit: str, what: str, gap_s: float, *failures: str) -> Outcome:
    return Outcome(Cell(hit, what, lambda stack: None, 1.0), Figures(gap_s=gap_s), failures)


def test_who_is_hit_stands_down_and_what_is_done_across() -> None:
    found = tables([outcome("fuser", "killed", 0.031), outcome("router", "killed", 0.05), outcome("fuser", "cut off", 0.12)])
    assert found.splitlines() == [
        "| hit | killed | cut off |",
        "| --- | --- | --- |",
        "| fuser | 0.03 | 0.12 |",
        "| router | 0.05 |  |",
    ]


def test_what_has_nothing_in_common_is_a_table_of_its_own_and_a_failure_is_named() -> None:
    found = tables([outcome("fuser", "killed", 0.03), outcome("reading/imu", "delay", 9.0, "9 s without a state")])
    assert found.splitlines() == [
        *["| hit | killed |", "| --- | --- |", "| fuser | 0.03 |", ""],
        *["| hit | delay |", "| --- | --- |", "| reading/imu | failed |"],
    ]


def test_a_cell_that_joins_two_groups_makes_them_one_table() -> None:
    found = tables([outcome("fuser", "killed", 0.1), outcome("router", "stopped", 0.2), outcome("router", "killed", 0.3)])
    assert found.splitlines()[2:] == ["| fuser | 0.10 |  |", "| router | 0.30 | 0.20 |"]
