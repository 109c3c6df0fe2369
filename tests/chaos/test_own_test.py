"""The chaos test of docs/chaos.md, as a user writes it."""

from __future__ import annotations

import pytest

from milepost.chaos.stack import Stack

pytestmark = pytest.mark.system


def test_the_position_survives_a_liar_and_a_death(stack: Stack) -> None:
    with stack.measured() as seen:
        stack.inject("radar-front", "bias", for_s=3.0, size=1.0)
        stack.kill(stack.leader)
        stack.recover(seen)
    assert seen.own_gap_s <= 0.3
    assert seen.violations == 0
    assert seen.compared > 0
