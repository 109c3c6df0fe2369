"""What the fuser holds possible, as a message."""

from __future__ import annotations

from typing import Any

from milepost.fusion.bank_state import Bank
from milepost.fusion.possible import possible
from milepost_schemas.hypotheses import MOST_HYPOTHESES, Hypotheses, Hypothesis

from .limits import FARTHEST_M, FASTEST_MPS, within


def hypotheses(head: dict[str, Any], epoch: int, bank: Bank) -> Hypotheses:
    """The hypotheses of a bank at an epoch, under this head."""
    told = [
        Hypothesis(
            without=list(each.without),
            judgement=each.judgement,
            position_m=within(each.position[0], FARTHEST_M),
            position_std_m=each.position[1],
            speed_mps=within(each.speed[0], FASTEST_MPS),
            speed_std_mps=each.speed[1],
        )
        for each in possible(bank)[:MOST_HYPOTHESES]
    ]
    return Hypotheses(**head, epoch=epoch, hypotheses=told)
