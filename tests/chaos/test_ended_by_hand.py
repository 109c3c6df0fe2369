"""Processes that somebody has ended by hand, and the supervisor of the others."""

from __future__ import annotations

import pytest

from milepost.chaos.stack import NORMAL_S, Stack

pytestmark = [pytest.mark.system, pytest.mark.long]


def test_what_fails_is_restarted_also_after_the_world_was_replaced(stack: Stack) -> None:
    """GIVEN a world that was ended with SIGTERM and started again by hand WHEN a sensor is killed THEN it comes back."""
    stack.terminate("world")
    stack.start("world")
    stack.back("world", NORMAL_S)
    stack.kill("sensor-gnss")
    stack.back("sensor-gnss", NORMAL_S)
    stack.recovered(NORMAL_S)
