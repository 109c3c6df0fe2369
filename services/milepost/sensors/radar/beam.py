"""The common part of Doppler radars of one or two beams: the beam, its errors, and how a filter takes a reading."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Any, TypeVar

from pydantic import Field

from milepost.estimation.beliefs import Beliefs
from milepost.estimation.layout import PrivateState
from milepost.recordings.options import Span
from milepost.simulation.noise import MarkovNoise, WhiteNoise

from ..base import Sensor, Simulated, World, as_simulated
from ..observed import Belief, Observed, Stacked
from ..scale import ScaleOptions, TrueScale, scaled_speed, scaled_speeds
from .dropouts import Dropouts, within

NonNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]
# a sign is known when the other one is this many times (e^2x, 1 in 2000) less likely
DECIDED = 3.8


NoiseRatio = Annotated[float, Field(ge=0.0, le=0.2)]
Pitch = Annotated[float, Field(ge=-10.0, le=10.0)]
PitchStd = Annotated[float, Field(ge=0.0, le=5.0)]


class SimulatedRadar(Simulated):
    """What the simulated radar really does. `scale` κ: constant; otherwise it is drawn from the prior."""

    scale: Annotated[float, Field(gt=-0.5, lt=1.0)] | None = None
    speed_variance_m2ps2: Positive | None = None
    noise_ratio: NoiseRatio | None = None
    mounting_pitch_deg: Pitch | None = None
    body_pitch_std_deg: PitchStd | None = None
    vertical_speed_std_mps: NonNegative | None = None
    body_time_constant_s: Positive | None = None


class RadarOptions(ScaleOptions):
    """`speed_variance_m2ps2` and `noise_ratio`: of one beam's white noise: R = R₀ + (ratio v)²; source A gives 0.04.

    `beam_angle_deg`: θ below the horizontal. `mounting_pitch_deg`: nose up, constant. `body_pitch_std_deg` and
    `vertical_speed_std_mps`: of the car body on its springs, first-order Markov with `body_time_constant_s`.
    Below `dead_zone_mps` (devices: 0.05 to 0.3) the device sends no reading, and no bound either: it cannot tell a
    slow train from a drop-out on water, where a bound would be false at any speed.
    `dropout_rate_hz`, `dropout_mean_s`: stretches without echo (water, snow); `dropout_spans_m`: places without.
    `signed: false`: it hears |v| alone. `simulated`: what the simulated radar really does, where that differs from what the
    device states and the filter believes.
    """

    rate_hz: Annotated[float, Field(gt=0.0, le=1000.0)] = 100.0
    speed_variance_m2ps2: Positive = 0.04
    noise_ratio: NoiseRatio = 0.0
    beam_angle_deg: Annotated[float, Field(ge=10.0, le=80.0)] = 45.0
    mounting_pitch_deg: Pitch = 0.0
    body_pitch_std_deg: PitchStd = 0.0
    vertical_speed_std_mps: NonNegative = 0.0
    body_time_constant_s: Positive = 0.2
    dead_zone_mps: NonNegative = 0.0
    dropout_rate_hz: NonNegative = 0.0
    dropout_mean_s: Positive = 2.0
    dropout_spans_m: list[Span] = Field(default_factory=list)
    signed: bool = True
    simulated: SimulatedRadar = Field(default_factory=SimulatedRadar)

    @property
    def really(self) -> RadarOptions:
        """The options of the simulated radar as it really is."""
        return as_simulated(self, self.simulated)

    @property
    def angle_rad(self) -> float:
        """θ."""
        return math.radians(self.beam_angle_deg)

    @property
    def mounting_pitch_rad(self) -> float:
        """The constant part of δ."""
        return math.radians(self.mounting_pitch_deg)

    @property
    def leak_variance(self) -> tuple[float, float]:
        """What the body's motion adds to R of one beam alone, as the factors of v² and of 1.

        Δv = v δ tan θ - w tan θ. Its error is coloured, so R states R_eff = R (1 + 2Σρ) = R coth(Δ/2τ) for readings Δ apart.
        """
        tan = math.tan(self.angle_rad)
        inflation = 1.0 / math.tanh(0.5 / (self.rate_hz * self.body_time_constant_s))
        pitch, vertical = math.radians(self.body_pitch_std_deg) * tan, self.vertical_speed_std_mps * tan
        return pitch * pitch * inflation, vertical * vertical * inflation


def beam_speed(v: float, w: float, pitch_rad: float, angle_rad: float, forward: bool) -> float:
    """z = λ f_r/(2 cos θ), the speed that a beam shows; f_r = 2 (velocity along the beam)/λ.

    `v` along the track, `w` upwards, nose up by δ, θ the nominal angle below the horizontal. Forward: the beam points
    θ - δ down: z = v cos(θ-δ)/cos θ - w sin(θ-δ)/cos θ = v (cos δ + tan θ sin δ) - w (tan θ cos δ - sin δ).
    Backward, its sign turned: z = v (cos δ - tan θ sin δ) + w (tan θ cos δ + sin δ). The mean of both: v cos δ + w sin δ.
    Source: D (3); the effect of pitch is geometry.
    """
    along, up = beam_gains(pitch_rad, angle_rad, forward)
    return v * along + w * up


def beam_gains(pitch_rad: float, angle_rad: float, forward: bool) -> tuple[float, float]:
    """What `beam_speed` multiplies v and w with."""
    tan, cos, sin = math.tan(angle_rad if forward else -angle_rad), math.cos(pitch_rad), math.sin(pitch_rad)
    return cos + tan * sin, sin - tan * cos


class Body:
    """The car body's pitch and vertical speed at each reading."""

    def __init__(self, unit: str, options: RadarOptions, world: World) -> None:
        step, tau = 1.0 / options.rate_hz, options.body_time_constant_s
        self._pitch = MarkovNoise(world.seed, f"{unit}.pitch", step, tau)
        self._vertical = MarkovNoise(world.seed, f"{unit}.vertical", step, tau)
        self._pitch_std = math.radians(options.body_pitch_std_deg)
        self._vertical_std = options.vertical_speed_std_mps
        self._still = self._pitch_std == self._vertical_std == 0.0

    def at(self, index: int) -> tuple[float, float]:
        """(pitch in rad, vertical speed)."""
        if self._still:
            return 0.0, 0.0
        return self._pitch_std * self._pitch[index], self._vertical_std * self._vertical[index]


class Beam:
    """One simulated beam: its echo, its noise, and when it hears nothing."""

    def __init__(self, label: str, options: RadarOptions, world: World, forward: bool) -> None:
        self._angle, self._forward = options.angle_rad, forward
        self._noise = WhiteNoise(world.seed, label)
        self._dropouts = Dropouts(world.seed, label, options.dropout_rate_hz, options.dropout_mean_s)
        self._stated = (options.speed_variance_m2ps2, options.noise_ratio)
        self._really = (options.really.speed_variance_m2ps2, options.really.noise_ratio)
        self._pitch = 0.0
        self._gains = beam_gains(0.0, self._angle, forward)

    def hears(self, t_s: float) -> bool:
        """Whether there is an echo."""
        return not self._dropouts.at(t_s)

    def show(self, index: int, v: float, w: float, pitch_rad: float, scale: float) -> tuple[float, float]:
        """The speed that it shows, z = (beam speed)/(1 + κ) + e, and the R that it states of its white noise e.

        The device knows R from the width of the Doppler spectrum: stated from z it would favour readings that are too low.
        """
        if pitch_rad != self._pitch:
            self._pitch, self._gains = pitch_rad, beam_gains(pitch_rad, self._angle, self._forward)
        shown = (v * self._gains[0] + w * self._gains[1]) / (1.0 + scale)
        return shown + _variance(*self._really, v) ** 0.5 * self._noise[index], _variance(*self._stated, v)


def _variance(R: float, ratio: float, v: float) -> float:
    return R + (ratio * v) ** 2


class Radar:
    """The part that simulated radars share: the train's position and speed, the body's motion and the scale."""

    def __init__(self, unit: str, options: RadarOptions, world: World) -> None:
        self._motion, self._options = world.motion, options
        self._body = Body(unit, options.really, world)
        self._scale = TrueScale(unit, options, options.simulated.scale, world, 1.0 / options.rate_hz)

    def at(self, index: int, t_s: float) -> tuple[float, float, float, float] | None:
        """(speed, vertical speed, pitch, scale) at a reading; None where the radar sends no reading."""
        s, v, _ = self._motion.at(t_s)
        if abs(v) < self._options.dead_zone_mps or within(s, self._options.dropout_spans_m):
            return None
        pitch, vertical = self._body.at(index)
        return v, vertical, pitch, self._scale[index]

    def fields(self, shown: float, variance: float) -> dict[str, Any]:
        """The reading's fields."""
        return {"speed_mps": shown if self._options.signed else abs(shown), "speed_variance_m2ps2": variance}


R = TypeVar("R", bound=RadarOptions)


class RadarSensor(Sensor[R]):
    """The observation of radars of one or two beams: h = [0, 1, 0], or `scaled_speed`'s row with a scale.

    Without a sign, z = ±|v|: the belief decides where one sign is far less likely (z |v̂| > 3.8 (P_vv + R)); where it
    cannot, z = 0 with the variance R + z², which holds both.
    """

    stream = "speed_reading"

    @property
    def never_repeats(self) -> bool:
        """Doppler speeds are noisy to the last digit."""
        return True

    @property
    def private_states(self) -> tuple[PrivateState, ...]:
        """`scale`, where the options say that it is uncertain."""
        return () if self.options.scale is None else (self.options.scale,)

    @property
    def needs_belief(self) -> bool:
        """For the scale, and for the sign."""
        return self.options.scale is not None or not self.options.signed

    @property
    def period_s(self) -> float:
        """One reading each 1/rate."""
        return 1.0 / self.options.rate_hz

    def observe(self, reading: Any, belief: Belief | None) -> Sequence[Observed]:
        """One row."""
        z, variance, scale = reading.speed_mps, reading.speed_variance_m2ps2, self.options.scale
        if z is None:
            return ()
        if not self.options.signed:
            v, P_vv = (0.0, 0.0) if belief is None else (float(belief.mean[1]), float(belief.covariance[1, 1]))
            decided = abs(z * v) > DECIDED * (P_vv + variance)
            z, variance = (math.copysign(z, v), variance) if decided else (0.0, variance + z * z)
        if scale is None:
            return (Observed((0.0, 1.0, 0.0), z, variance),)
        return (scaled_speed(z, variance, belief, scale),)

    def observe_each(self, reading: Any, beliefs: Beliefs) -> list[Stacked]:
        """`observe` at each belief."""
        z, variance = reading.speed_mps, reading.speed_variance_m2ps2
        if z is None or not self.options.signed:
            return super().observe_each(reading, beliefs)
        if self.options.scale is None:
            return [Stacked((0.0, 1.0, 0.0), z, variance)]
        return [scaled_speeds(z, variance, beliefs)]
