"""Of several answers that one counts which most of the train's processes give."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from examples import T0, head
from milepost.nodes.catching_up.agreement import most_agreed, most_told
from milepost_schemas import Feedback, Gaussian, SimulationStart

KNOWN = ("fuser", "filter-a", "filter-b", "filter-c", "filter-d")
NAMES = ["position_m", "speed_mps", "acceleration_mps2"]
S = 1_000_000_000


def fed_back(after_s: float, off_m: float = 0.0, variance: float = 0.01, **changed: Any) -> Feedback:
    """The fused state of a train at 20 m/s, so long after `T0`."""
    at = T0 + round(after_s * S)
    fused = Gaussian(states=NAMES, mean=[20.0 * after_s + off_m, 20.0, 0.0], covariance=(np.eye(3) * variance).tolist())
    fields = head("fuser", sequence=round(after_s * 20), measured_at_ns=at, published_at_ns=at)
    return Feedback(**{**fields, **changed}, fused=fused, shares={})


TRUE = fed_back(10.0)


@pytest.mark.parametrize(
    "lie",
    [fed_back(10.4, 1000.0), fed_back(10.4, 0.0, 1e-6), fed_back(10.4, 0.0, 1e4), fed_back(0.0, 50.0)],
    ids=["elsewhere", "too sure", "too unsure", "old"],
)
@pytest.mark.parametrize("name", ["stranger", "filter-a", "filter-d"])
def test_a_single_lie_counts_for_nothing_among_three(lie: Feedback, name: str) -> None:
    told = [(name, lie), *((known, TRUE) for known in KNOWN[:3])]
    assert most_agreed(told, KNOWN) == TRUE
    assert most_agreed(told[::-1], KNOWN) == TRUE


def test_honest_processes_that_are_an_epoch_apart_agree_against_a_lie() -> None:
    newer = fed_back(10.05)
    told = [("filter-a", TRUE), ("filter-b", newer), ("filter-c", fed_back(10.4, 1000.0))]
    assert most_agreed(told, KNOWN) == newer


def test_of_states_that_agree_that_counts_which_most_give_word_by_word() -> None:
    told = [("filter-a", TRUE), ("filter-b", TRUE), ("filter-c", fed_back(10.4, 0.9))]
    assert most_agreed(told, KNOWN) == TRUE


def test_strangers_are_not_counted_however_many_they_are() -> None:
    told = [*((f"x{i}", fed_back(10.4, 1000.0)) for i in range(9)), ("filter-a", TRUE)]
    assert most_agreed(told, KNOWN) == TRUE
    assert most_agreed(told[:9], KNOWN) is None


def test_the_start_is_what_most_say() -> None:
    start, lie = (SimulationStart(start_ns=T0 + i, speed=1.0, end_ns=T0 + S) for i in range(2))
    assert most_told([("world", lie), ("world", start), ("filter-a", start)], {*KNOWN, "world"}) == start
    assert most_told([("stranger", lie)], KNOWN) is None
    assert most_told([("world", start), ("filter-a", lie)], {*KNOWN, "world"}) == start, "between equals the first"
