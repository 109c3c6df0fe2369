"""The H∞ filter."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..h_infinity import Existence, HInfinityKernel
from ..layout import Layout
from ..notice import Notice
from .base import FilterSetup, LocalFilter
from .options import positive


@dataclass(frozen=True)
class HInfinityOptions:
    """`gamma` γ, the bound; `position_scale_m`, `speed_scale_mps`: the error in each that counts as one.

    With neither, L is the observed combination in units of its standard deviation, as in the source, whose one state is
    the measured speed. With a scale, L has a row e_s/scale or e_v/scale: the error that must stay bounded.
    """

    gamma: float = 2.3
    position_scale_m: float | None = None
    speed_scale_mps: float | None = None

    def __post_init__(self) -> None:
        # γ → ∞ is the Kalman filter
        if not self.gamma > 0.0:
            raise ValueError("gamma: must be above 0")
        positive(self, *(f for f in ("position_scale_m", "speed_scale_mps") if getattr(self, f) is not None))


class HInfinityFilter(LocalFilter[HInfinityOptions]):
    """Bounds the worst-case error of its belief by γ; it passes observations on unchanged.

    -γ⁻²LᵀL makes the increment indefinite, so it shapes the filter's own belief and never the fused result.
    Source: D (9)-(15).
    """

    kind = "h_infinity"
    options_model = HInfinityOptions

    def __init__(self, setup: FilterSetup, options: HInfinityOptions) -> None:
        self._existence = Existence()
        self._failing = False
        super().__init__(setup, options)

    def kernel(self, layout: Layout, jerk_psd: float) -> Any:
        """The H∞ steps over the layout."""
        scales = (self.options.position_scale_m, self.options.speed_scale_mps)
        rows = [np.eye(layout.dimension)[i] / scale for i, scale in enumerate(scales) if scale is not None]
        return HInfinityKernel(
            layout,
            jerk_psd,
            gamma=self.options.gamma,
            combinations=np.array(rows) if rows else None,
            existence=self._existence,
        )

    def notices(self) -> list[Notice]:
        """A notice when the filter ceases to exist, and one when it exists again."""
        existence = self._existence
        held, failed = existence.held, existence.failed
        existence.held = existence.failed = 0
        if failed and not self._failing:
            self._failing = True
            text = (
                f"P⁻¹ + HᵀH - γ⁻²LᵀL is not positive definite for γ = {self.options.gamma:g}: the Kalman step is taken instead"
            )
            return [Notice("warning", "h_infinity_infeasible", text)]
        if held and not failed and self._failing:
            self._failing = False
            return [Notice("info", "h_infinity_feasible", f"the filter for γ = {self.options.gamma:g} exists again")]
        return []
