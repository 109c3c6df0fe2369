"""Cross-induction loop: one pulse at each crossing of the loop laid along the track."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from milepost.estimation.beliefs import Beliefs
from milepost.recordings.measured import Source

from ..base import Pause, Sensor, World
from ..observed import Belief, Observed, Stacked
from ..pulses import NEGLIGIBLE
from .count import Faults, pitches
from .direction import SPEED, signed, signed_each
from .options import InductionLoopOptions
from .simulated import SimulatedLoop


class InductionLoop(Sensor[InductionLoopOptions]):
    """|v| from pulse timing: z = n p/Δt over the n pitches between the last pulses of two sampling windows.

    Stamped at mid-interval: a difference of positions is the mean speed, which equals the speed there up to e = J Δt²/24 (see
    `pulses`). Each pitch is off by N(0, σ²) independently, so R = n σ²/Δt² + e², and the errors of the readings add up to a
    position error that grows as √n. Pulses do not tell the direction: the belief decides the sign (`direction.signed`). If
    the train may have turned round (`direction.Reversals`), it moved by anything up to n p, which adds (n p/Δt)²/3 to R. A
    long silence is a bound, never zero: z = 0 with the variance given in `pulses`. Source: A (11).

    A missed crossing makes one reading of n pitches say m = n - 1, and the position one pitch too low until the next fix.
    Where crossings can be missed, n comes from m and the belief's speed (see `count`): z = E[n] p/Δt,
    R = E[n] σ²/Δt² + Var[n] p²/Δt², and what the device stated beyond m σ²/Δt².
    """

    kind = "induction_loop"
    stream = "speed_reading"
    options_model = InductionLoopOptions

    @property
    def never_repeats(self) -> bool:
        """Pulses are timed to the last digit."""
        return True

    @property
    def pause(self) -> Pause:
        """Between pulses there is none but a bound a window."""
        return self.options.limits.pause(self.options.longest_gap_m)

    @property
    def needs_belief(self) -> bool:
        """For the sign, and for the number of missed crossings."""
        return True

    def observe(self, reading: Any, belief: Belief | None) -> Sequence[Observed]:
        """h = [0, 1, 0]."""
        options, dt = self.options, reading.interval_s
        if reading.speed_mps is None:
            return (Observed(SPEED, 0.0, options.limits.bound_variance(reading.speed_max_mps, dt)),)
        faults, z, R = options.faults, reading.speed_mps, reading.speed_variance_m2ps2
        if faults is not None and dt > 0.0:
            z, R = self._counted(z, R, dt, belief, faults)
        return signed(z, R, belief)

    def observe_each(self, reading: Any, beliefs: Beliefs) -> list[Stacked]:
        """`observe` at each belief."""
        if reading.speed_mps is not None and self.options.faults is None:
            together = signed_each(reading.speed_mps, reading.speed_variance_m2ps2, beliefs)
            if together is not None:
                return [together]
        return super().observe_each(reading, beliefs)

    def _counted(
        self, speed_mps: float, variance_m2ps2: float, dt: float, belief: Belief | None, faults: Faults
    ) -> tuple[float, float]:
        """|v| and its variance with the missed pitches counted."""
        pitch, std = self.options.pitch_m, self.options.pitch_std_m
        seen = max(1, round(speed_mps * dt / pitch))
        expected, variance = None, 0.0
        if belief is not None:
            expected = abs(float(belief.mean[1])) * dt / pitch
            variance = float(belief.covariance[1, 1]) * (dt / pitch) ** 2
        n = pitches(seen, expected, variance, (std / pitch) ** 2, faults)
        beyond = variance_m2ps2 - seen * std * std / (dt * dt)
        if beyond < NEGLIGIBLE * variance_m2ps2:
            beyond = 0.0
        return n.mean * pitch / dt, (n.mean * std * std + n.variance * pitch * pitch) / (dt * dt) + beyond

    def open(self, world: World | None, from_s: float) -> Source:
        """Simulated crossings of the world's motion."""
        world = self.needed(world)
        return SimulatedLoop(self.unit, self.options, world, from_s)
