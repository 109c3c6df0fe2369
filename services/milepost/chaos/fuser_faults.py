"""Blows on one of several fusers: on its memory, and on its clock."""

from __future__ import annotations

from collections.abc import Callable

from .stack import Stack

VOTER = "voter"
CLOCK_FOR_S = 4.0
TOLD_S = 30.0


def flip(fuser: str, state: str, bit: int) -> Callable[[Stack], None]:
    """A bit of one fuser's belief is flipped, until the voter has named it and gives it a vote again."""

    def blow(stack: Stack) -> None:
        begun = len(stack.events)
        stack.inject(fuser, "bit_flip", None, state=state, bit=bit)
        said = VOTER, fuser, "fuser_outvoted", "fuser_readmitted"
        stack.wait_for(lambda: _told(stack, begun, *said), TOLD_S, f"{fuser} has a vote again")

    return blow


def set_clock(off_s: float) -> Callable[[Stack, str], None]:
    """The clock of a fuser is off for a while."""

    def blow(stack: Stack, process: str) -> None:
        begun = len(stack.events)
        stack.inject(process, "wrong_clock", CLOCK_FOR_S, by_s=off_s)
        # one that was ahead stands still before it is right
        said = process, process, "clock_wrong", "clock_right"
        stack.wait_for(lambda: _told(stack, begun, *said), TOLD_S, f"the clock of {process} is right")

    return blow


def _told(stack: Stack, begun: int, unit: str, about: str, *codes: str) -> bool:
    """Whether a unit has said all this of a process since."""
    told = {event.code for event in stack.events[begun:] if event.unit == unit and event.text.startswith(f"{about}:")}
    return told >= set(codes)
