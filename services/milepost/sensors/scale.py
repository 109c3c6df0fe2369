"""A speed with an unknown scale error, as an observation of the speed and of the scale."""

from __future__ import annotations

import math
from typing import Annotated, Any

import numpy as np
from pydantic import Field, model_validator

from milepost.estimation.beliefs import Beliefs
from milepost.estimation.layout import N_COMMON, PrivateState
from milepost.simulation.noise import MarkovNoise, WalkNoise

from .base import SensorOptions, World
from .observed import Belief, Observed, Stacked

SCALE = N_COMMON


class ScaleOptions(SensorOptions):
    """A sensor with an unknown scale error κ; with `scale_std: 0` the filter has no such state.

    κ is constant, a random walk (`scale_noise_psd`, 1/s) or first-order Markov about 0 (`scale_time_constant_s`).
    """

    scale_std: Annotated[float, Field(ge=0.0, le=0.3)] = 0.0
    scale_time_constant_s: Annotated[float, Field(gt=0.0)] | None = None
    scale_noise_psd: Annotated[float, Field(ge=0.0)] = 0.0

    @model_validator(mode="after")
    def _one_kind_of_motion(self) -> ScaleOptions:
        if self.scale_time_constant_s is not None and self.scale_noise_psd > 0.0:
            raise ValueError("scale_noise_psd must not stand beside scale_time_constant_s")
        return self

    @property
    def scale(self) -> PrivateState | None:
        """The private state, where there is one."""
        std, tau = self.scale_std, self.scale_time_constant_s
        if std == 0.0:
            return None
        if tau is None:
            return PrivateState("scale", 0.0, std, math.inf, self.scale_noise_psd, scales_motion=True)
        return PrivateState("scale", 0.0, std, tau, 2.0 * std * std / tau, scales_motion=True)


class TrueScale:
    """The simulated κ at each reading, `step_s` apart: `constant`, or drawn from the prior and moving as it says."""

    def __init__(self, unit: str, options: ScaleOptions, constant: float | None, world: World, step_s: float) -> None:
        state = options.scale
        self._moving: MarkovNoise | WalkNoise | None = None
        self._constant, self._size = constant or 0.0, 0.0
        if constant is not None or state is None:
            return
        label = f"{unit}.{state.name}"
        if options.scale_time_constant_s is not None:
            self._moving, self._size = MarkovNoise(world.seed, label, step_s, state.time_constant_s), state.prior_std
            return
        self._constant = world.true_value(unit, state)
        if state.noise_psd > 0.0:
            self._moving, self._size = WalkNoise(world.seed, label), math.sqrt(state.noise_psd * step_s)

    def __getitem__(self, index: int) -> float:
        return self._constant if self._moving is None else self._constant + self._size * self._moving[index]


def scaled_speed(speed_mps: float, variance_m2ps2: float, belief: Belief | None, scale: PrivateState) -> Observed:
    """z = v/(1 + κ) + e, e ~ N(0, R): the speed of a wheel or a radar with the scale error κ, the only private state.

    With μ = 1 + κ̂, the expected reading ẑ = v̂/μ and the innovation ν = z - ẑ: v - ẑ κ = ẑ + μ ν + δκ w - μ e, where δκ is
    the error of κ̂ and w that of ẑ. So h = [0, 1, 0, -ẑ], value ẑ + μ ν + E[δκ w], variance μ² R + Var(δκ w), with
    E[δκ w] = c/μ, Var(δκ w) = (P_κκ h P hᵀ + c²)/μ², c = P_κv - ẑ P_κκ. Without a belief ẑ = z, μ = 1 + prior.
    For a wheel κ is true over nominal diameter, less one.

    Why κ divides: for a mean reading z all (v, κ) that explain it lie on the straight line v = (1 + κ) z, which one row
    holds exactly: what is left out, δκ w, fades as ẑ becomes known, whatever κ's uncertainty. In z = (1 + κ) v they lie on a
    hyperbola; δκ δv is then one error common to all readings until κ is known. At 60 m/s and κ ~ N(0, 0.03²), 100 readings
    a second: NEES 4.3 here, 111 there (75 with the mean and variance of δκ δv in each reading), for 4. The line turns with ẑ;
    that the covariance turns with it is `estimation.gaussian.stretched`.
    """
    if belief is None:
        row = (0.0, 1.0, 0.0, -speed_mps)
        return Observed(row, speed_mps, ((1.0 + scale.prior_mean) ** 2 + scale.prior_std**2) * variance_m2ps2)
    v, k, P = float(belief.mean[1]), float(belief.mean[SCALE]), belief.covariance
    moments = float(P[1, 1]), float(P[1, SCALE]), float(P[SCALE, SCALE])
    expected, value, variance = _linearised(speed_mps, variance_m2ps2, v, k, *moments)
    return Observed((0.0, 1.0, 0.0, -expected), value, variance)


def scaled_speeds(speed_mps: float, variance_m2ps2: float, beliefs: Beliefs) -> Stacked:
    """`scaled_speed` at each of H beliefs."""
    moments = beliefs.covariance(1, 1), beliefs.covariance(1, SCALE), beliefs.covariance(SCALE, SCALE)
    expected, value, variance = _linearised(speed_mps, variance_m2ps2, beliefs.mean(1), beliefs.mean(SCALE), *moments)
    rows = np.zeros((4, len(expected)))
    rows[1], rows[SCALE] = 1.0, -expected
    return Stacked(rows, value, variance)


def _linearised(z: float, R: float, v: Any, k: Any, P_vv: Any, P_kv: Any, P_kk: Any) -> tuple[Any, Any, Any]:
    """The expected reading, the value and the variance of `scaled_speed`, for numbers and for arrays."""
    mu = 1.0 + k
    expected = v / mu
    c = P_kv - expected * P_kk
    # P_vv - 2 ẑ P_κv + ẑ² P_κκ
    hPh = P_vv - expected * (P_kv + c)
    squared = mu * mu
    value = expected + mu * (z - expected) + c / mu
    return expected, value, squared * R + (P_kk * hPh + c * c) / squared
