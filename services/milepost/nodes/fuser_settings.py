"""The settings of the fuser's node, from a train file."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from milepost.estimation.estimator import Prior
from milepost.estimation.layout import Layout
from milepost.fusion.hypotheses import Doubts
from milepost.fusion.shares import Shares

from .judges import UnitJudge
from .unit_record import UnitRow


@dataclass(frozen=True)
class FuserSettings:
    """The settings of fusion in a train file; `sigmas` and `lost_above_m` as in `state_writer`.

    `judges`: the units whose readings are linearised and judged here instead of in their filters. `doubts`: which units may
    be lying, and how much risk is accepted. `fingerprint`: fusers of the same one compute the same.
    """

    rule: str
    period_ns: int
    deadline_ns: int
    horizon_ns: int
    feedback: bool
    feedback_every: int
    shares: Shares
    sigmas: float
    lost_above_m: float
    jerk_psd: float
    prior: Prior
    layout: Layout
    units: list[UnitRow]
    judges: Mapping[str, UnitJudge] = field(default_factory=dict)
    doubts: Doubts = field(default_factory=Doubts)
    fingerprint: str = ""
