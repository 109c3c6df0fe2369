"""Strapdown inertial unit: three accelerometers and three gyroscopes, mechanised along the track."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from milepost.estimation.beliefs import Beliefs
from milepost.estimation.layout import PrivateState
from milepost.recordings.measured import Measured, Source
from milepost.simulation.noise import MarkovNoise, WhiteNoise
from milepost_schemas import InertialReading

from ..base import Observer, Sensor, SensorOptions, Simulated, World, as_simulated
from ..observed import Belief, Observed, Stacked
from ..periodic import PeriodicSource
from .learned_error import InertialErrorModel
from .learning import LearningUnit, LearnOptions

GRAVITY_MPS2 = 9.80665
AXES = ("forward", "right", "down")
# where a belief's gravity is looked at, in its standard deviations: (3, 1)
AROUND = np.array([[0.0], [1.0], [-1.0]])
NonNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]


class SimulatedImu(Simulated):
    """What the simulated unit really does."""

    noise_density_mps2_rthz: NonNegative | None = None
    bias_std_mps2: NonNegative | None = None
    bias_time_constant_s: Positive | None = None
    turn_noise_density_radps_rthz: NonNegative | None = None
    turn_bias_std_radps: NonNegative | None = None
    pitch_rad_per_mps2: NonNegative | None = None


class ImuOptions(SensorOptions):
    """RAIL.md's MEMS unit by default.

    `noise_density_mps2_rthz`, `turn_noise_density_radps_rthz`: of one axis. `bias_std_mps2`, `turn_bias_std_radps`: of a
    first-order Markov bias with `bias_time_constant_s`; `bias_std_mps2: 0` makes a unit without a bias and without that
    private state. `pitch_rad_per_mps2`: how far the body's nose rises under acceleration. `model_bias: false` keeps the
    simulated bias from the filter, as sources without a bias state have it. `learn`: the error is learned while the fused
    state is good, and taken off (see `learning`). `simulated`: what the simulated unit really does, where that differs from
    what the filter believes.
    """

    rate_hz: Annotated[float, Field(gt=0.0, le=400.0)] = 20.0
    noise_density_mps2_rthz: Positive = 0.05
    bias_std_mps2: NonNegative = 0.005
    bias_time_constant_s: Positive = 900.0
    turn_noise_density_radps_rthz: NonNegative = 1.745e-4
    turn_bias_std_radps: NonNegative = 3.49e-4
    pitch_rad_per_mps2: NonNegative = 0.0
    model_bias: bool = True
    learn: LearnOptions | None = None
    simulated: SimulatedImu = Field(default_factory=SimulatedImu)

    @model_validator(mode="after")
    def _one_stands_for_the_bias(self) -> ImuOptions:
        # both together are overconfident: NEES 6 for 3, where each by itself has 2 to 3
        if self.learn is not None and self.model_bias:
            raise ValueError("learn stands in for a bias in the state: it needs model_bias: false")
        return self


class Imu(Sensor[ImuOptions]):
    """z = f_x - g sin θ(ŝ) = a + b + e: the forward specific force without gravity's part on the line's gradient θ.

    f_x is a mean over the reading's interval Δ, so R = N²/Δ (N noise density) + (half the difference of g sin θ over
    ŝ ± σ_s)²: where the train is not known, neither is the gradient. b is private: first-order Markov, ḃ = -b/τ + w.
    The other axes (v² κ to the right, gyroscopes along curvature and change of gradient) are published, not fused: the
    line is known, so they add nothing to [s, v, a] on a straight. Source: B (strapdown unit compensated by feedback).
    """

    kind = "imu"
    stream = "inertial_reading"
    options_model = ImuOptions

    @property
    def never_repeats(self) -> bool:
        """Accelerations are noisy to the last digit."""
        return True

    @property
    def private_states(self) -> tuple[PrivateState, ...]:
        """`bias` in m/s², where there is one and the filter models it."""
        std, tau = self.options.bias_std_mps2, self.options.bias_time_constant_s
        if not (std > 0.0 and self.options.model_bias):
            return ()
        return (PrivateState("bias", 0.0, std, tau, 2.0 * std * std / tau),)

    @property
    def needs_belief(self) -> bool:
        """Where there is a gradient, it depends on the position; an error is learned from the belief."""
        return bool(self.line.gradient) or self.options.learn is not None

    @property
    def period_s(self) -> float:
        """One reading each 1/rate."""
        return 1.0 / self.options.rate_hz

    @property
    def latency_s(self) -> float:
        """Half the interval over which a reading is a mean."""
        return 0.5 / self.options.rate_hz

    def observe(self, reading: InertialReading, belief: Belief | None) -> Sequence[Observed]:
        """h = [0, 0, 1] and 1 for the bias."""
        R = self.options.noise_density_mps2_rthz**2 / reading.mean_over_s
        gravity = 0.0
        if belief is not None:
            s, reach = float(belief.mean[0]), math.sqrt(max(float(belief.covariance[0, 0]), 0.0))
            gravity = self._gravity(s)
            R += 0.25 * (self._gravity(s + reach) - self._gravity(s - reach)) ** 2
        row = (0.0, 0.0, 1.0) + (1.0,) * len(self.private_states)
        return (Observed(row, reading.specific_force_mps2[0] - gravity, R),)

    def observe_each(self, reading: InertialReading, beliefs: Beliefs) -> list[Stacked]:
        """`observe` at each belief; h is the same for all."""
        s, reach = beliefs.mean(0), np.sqrt(np.maximum(beliefs.covariance(0, 0), 0.0))
        slopes = self.line.slopes_at(s + AROUND * reach)
        here, ahead, behind = GRAVITY_MPS2 * slopes / np.sqrt(1.0 + slopes * slopes)
        R = self.options.noise_density_mps2_rthz**2 / reading.mean_over_s + 0.25 * (ahead - behind) ** 2
        row = (0.0, 0.0, 1.0) + (1.0,) * len(self.private_states)
        return [Stacked(row, reading.specific_force_mps2[0] - here, R)]

    def observer(self) -> Observer:
        """The unit itself, or one that learns."""
        o = self.options
        if o.learn is None:
            return self
        walk_std = o.bias_std_mps2 * math.sqrt(2.0 / o.bias_time_constant_s)
        model = InertialErrorModel(
            o.bias_std_mps2, walk_std, o.noise_density_mps2_rthz, o.learn.window_s, o.learn.memory_s or 0.0
        )
        return LearningUnit(self.observe, o.learn, model)

    def _gravity(self, position_m: float) -> float:
        slope = self.line.slope_at(position_m)
        return GRAVITY_MPS2 * slope / math.sqrt(1.0 + slope * slope)

    def open(self, world: World | None, from_s: float) -> Source:
        """Simulated readings of the world's motion on the line's gradient and curves."""
        world = self.needed(world)
        return _Simulated(self.unit, as_simulated(self.options, self.options.simulated), world, from_s)


class _Simulated(PeriodicSource):
    """The reading number k is the mean over (t_{k-1}, t_k], true at its middle."""

    def __init__(self, unit: str, options: ImuOptions, world: World, from_s: float) -> None:
        super().__init__(1.0 / options.rate_hz, max(from_s, 1.0 / options.rate_hz), world.motion.end_s)
        self._motion, self._line, self._options = world.motion, world.line, options
        step, tau = self.period_s, options.bias_time_constant_s
        self._white = [WhiteNoise(world.seed, f"{unit}.{kind}.{axis}") for kind in ("force", "turn") for axis in AXES]
        self._bias = [
            MarkovNoise(world.seed, f"{unit}.{kind}.{axis}.bias", step, tau) for kind in ("force", "turn") for axis in AXES
        ]
        per_root = 1.0 / math.sqrt(step)
        densities = [options.noise_density_mps2_rthz] * 3 + [options.turn_noise_density_radps_rthz] * 3
        self._noise_std = [density * per_root for density in densities]
        self._bias_std = [options.bias_std_mps2] * 3 + [options.turn_bias_std_radps] * 3

    def sample(self, index: int, t_s: float) -> Measured:
        half = 0.5 * self.period_s
        before, after = self._motion.at(t_s - 2.0 * half)[1], self._motion.at(t_s)[1]
        s, v, _ = self._motion.at(t_s - half)
        a = (after - before) / self.period_s
        slope = self._line.slope_at(s)
        bend = self._line.slope_at(s + 1.0) - self._line.slope_at(s)
        curvature = self._line.track.curvature(s) if self._line.track is not None else 0.0
        nose = math.atan(slope) + self._options.pitch_rad_per_mps2 * a
        true = (
            a + GRAVITY_MPS2 * math.sin(nose),
            v * v * curvature,
            -GRAVITY_MPS2 * math.cos(nose) - v * v * bend,
            0.0,
            v * bend,
            v * curvature,
        )
        seen = [
            value + bias_std * bias[index] + noise_std * white[index]
            for value, bias_std, bias, noise_std, white in zip(
                true, self._bias_std, self._bias, self._noise_std, self._white, strict=True
            )
        ]
        fields = {"specific_force_mps2": seen[:3], "turn_rate_radps": seen[3:], "mean_over_s": self.period_s}
        return Measured(t_s - half, fields)
