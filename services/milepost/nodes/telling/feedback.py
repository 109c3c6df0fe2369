"""What the fuser sends back to the filters."""

from __future__ import annotations

from typing import Any

from milepost.fusion.rule import Fused
from milepost.nodes.roster import Presence
from milepost_schemas import Feedback, FusedState, Gaussian

INTERVAL = ("position_min_m", "position_max_m", "speed_min_mps", "speed_max_mps")


def feedback_of(head: dict[str, Any], names: list[str], fused: Fused, presence: Presence, state: FusedState) -> Feedback:
    """The feedback of an epoch: the fused marginal over `names`, the shares, and the interval that `state` publishes."""
    body = Gaussian(states=names, mean=fused.mean, covariance=fused.covariance)
    interval = {name: getattr(state, name) for name in INTERVAL}
    return Feedback(**head, fused=body, shares=dict(presence.shares), **interval)
