"""The chaos test of docs/chaos.md, as a user writes it."""

from __future__ import annotations

import pytest

from lighter import lighter
from milepost.chaos.stack import Stack

pytestmark = pytest.mark.system


@pytest.fixture(scope="session")
def milepost_train(tmp_path_factory: pytest.TempPathFactory) -> str:
    """The train that breaks."""
    return str(lighter("full", tmp_path_factory.mktemp("train")))


def test_the_position_survives_a_liar_and_a_death(stack: Stack) -> None:
    with stack.measured() as seen:
        stack.inject("radar-front", "bias", for_s=3.0, size=1.0)
        stack.kill(stack.leader)
        stack.recover(seen)
    assert seen.own_gap_s <= 1.0
    assert seen.violations == 0
    assert seen.compared > 0
