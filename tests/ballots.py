"""Fusers that propose and a voter, by hand: epochs of 20 ms, closed 100 ms after their time or their first candidate."""

from __future__ import annotations

from typing import Any

from examples import EXAMPLES, GAUSSIAN, T0, head
from milepost.nodes.voting.agreement import Tolerance
from milepost.nodes.voting.voter import VoterNode
from milepost_schemas import Candidate, Gaussian

MS = 1_000_000
NAMES = ["fuser", "fuser-2", "fuser-3"]
TOLERANCE = Tolerance(0.05, 0.02, 1.0, 0.5, 0.2)
STATE, FEEDBACK = EXAMPLES["state"][0], EXAMPLES["feedback"][0]


def voter() -> VoterNode:
    return VoterNode("maglev-1", "v1", NAMES, TOLERANCE, 20 * MS, 100 * MS, 1000 * MS)


def candidate(unit: str, number: int, off_m: float = 0.0, **changed: Any) -> Candidate:
    """The candidate of epoch `number`, `number`·20 ms after T0; `off_m`: how far along the whole state is moved."""
    at = T0 + number * 20 * MS
    moved = {name: getattr(STATE, name) + off_m for name in ("position_m", "position_min_m", "position_max_m")}
    state = STATE.model_copy(update={**moved, **head(unit, measured_at_ns=at), "epoch": at // (20 * MS), **changed})
    fused = Gaussian(
        states=GAUSSIAN.states, mean=[GAUSSIAN.mean[0] + off_m, *GAUSSIAN.mean[1:]], covariance=GAUSSIAN.covariance
    )
    feedback = FEEDBACK.model_copy(update={**head(unit, measured_at_ns=at), "fused": fused})
    return Candidate(**head(unit, measured_at_ns=at, sequence=max(number, 0)), state=state, feedback=feedback)


def at(epoch: int, later_ms: float = 5.0) -> int:
    return T0 + epoch * 20 * MS + round(later_ms * MS)
