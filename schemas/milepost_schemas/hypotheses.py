"""What a fuser holds possible: the train's position and speed for each way in which its units may lie."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field

from .message import Count, Message, Name, NonNegative, Part, PositionM, SpeedMps

# `leads`: it is the published position and speed; `held`: its interval is part of the published one; `unlikely`: neither, for
# others explain the readings much better from the outset; `refuted`: the readings contradict it
Judgement = Literal["leads", "held", "unlikely", "refuted"]
MOST_HYPOTHESES = 256


class Hypothesis(Part):
    """One hypothesis: just the units in `without` lie, and what the others say is true.

    `motion-model` among them: the train moves harder than its train file says.
    """

    without: list[Name]
    judgement: Judgement
    position_m: PositionM
    position_std_m: NonNegative
    speed_mps: SpeedMps
    speed_std_mps: NonNegative


class Hypotheses(Message):
    """The hypotheses of a fuser at the epoch `measured_at_ns`: that of what is excluded, and those of one cause more.

    Those by which the fewest units lie come first. Each has heard all readings of the units that it believes, and none of the
    others, from the start: a fuser that excludes a unit publishes another hypothesis.
    """

    SCHEMA: ClassVar[str] = "hypotheses"

    epoch: Count
    hypotheses: Annotated[list[Hypothesis], Field(max_length=MOST_HYPOTHESES)]
