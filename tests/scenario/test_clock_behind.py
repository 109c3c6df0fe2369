"""A unit's clock steps back so soon that its stamps lie before the first reading of all."""

from __future__ import annotations

import pytest
from test_one_after_another import ROOT, suffered

pytestmark = pytest.mark.long

UNITS = {"regional": ("radar", "odometer-front"), "maglev": ("radar", "loop"), "metro": ("radar-1",), "full": ("radar-front",)}
# when it steps, and by how many seconds
STEPS = [(1.5, -4.8), (0.9, -2.0), (0.3, -0.9)]


@pytest.mark.parametrize(("from_s", "by_s"), STEPS)
@pytest.mark.parametrize(("train", "unit"), [(train, unit) for train, units in UNITS.items() for unit in units])
def test_it_does_not_move_the_prior_of_those_that_do_not_hear_it(train: str, unit: str, from_s: float, by_s: float) -> None:
    """GIVEN a moving train WHEN a clock steps back within the first seconds THEN the truth stays inside."""
    step = {"unit": unit, "kind": "clock_step", "from_s": from_s, "by_s": by_s, "for_s": 15.0}
    journey = suffered(30.0, step, file=ROOT / f"deploy/trains/{train}.yaml")
    assert journey.outside() == []
