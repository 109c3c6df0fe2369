"""The simulated loop: antennas over crossings as laid, and the device that reads them out in periods."""

from __future__ import annotations

from milepost.recordings.measured import Measured

from ..base import World
from ..periodic import PeriodicSource
from ..pulses import SHORTEST_PART, Silence
from .antenna import Antenna, Pair, Single
from .crossings import Crossings, Unseen
from .direction import Reversals
from .options import InductionLoopOptions


class SimulatedLoop(PeriodicSource):
    """One reading a period: a value if there were pulses, a bound if there have been none for long enough."""

    def __init__(self, unit: str, options: InductionLoopOptions, world: World, from_s: float) -> None:
        super().__init__(1.0 / options.rate_hz, from_s, world.motion.end_s, options.phase_s)
        self._pitch, self._variance, self._limits = options.pitch_m, options.pitch_std_m**2, options.limits
        self._t = self.time_of(self._index)
        self._index += 1
        laid = options.laid
        self._antennas = [
            Antenna(
                Crossings(world.seed, unit, laid.pitch_m, laid.pitch_std_m),
                Unseen(
                    world.seed,
                    f"{unit}.{i}",
                    laid.pitch_m,
                    laid.missed_probability,
                    laid.joint_every_m,
                    laid.joint_length_m,
                ),
                world.motion,
                -i * options.antenna_spacing_m,
                self._t,
            )
            for i in range(options.antennas)
        ]
        self._device = Single() if options.antennas == 1 else Pair()
        self._silence = Silence(self._t, options.longest_gap_m, options.limits)
        self._reversals = Reversals(options.pitch_m, options.pitch_std_m, options.acceleration_max_mps2)

    def sample(self, index: int, t_s: float) -> Measured | None:  # noqa: ARG002
        """The reading at the end of a period; None where there is none."""
        from_s, self._t = self._t, t_s
        seen = [antenna.look(from_s, t_s) for antenna in self._antennas]
        last_s = max((pulses.last_s for pulses in seen if pulses is not None), default=None)
        chosen = self._device.choose(seen)
        if last_s is None:
            return self._silence.bound(t_s)
        self._silence.broken(last_s)
        if chosen is None or chosen.before_s is None:
            return None
        return self._value(chosen.passed, chosen.before_s, chosen.last_s)

    def _value(self, pulses: int, before_s: float, last_s: float) -> Measured | None:
        one_way = self._reversals.excluded(pulses, last_s - before_s)
        from_s, doubt_m2 = self._silence.rest(before_s)
        dt, path_m = last_s - from_s, pulses * self._pitch
        if not one_way and dt < SHORTEST_PART * self.period_s:
            return None
        doubt_m2 += pulses * self._variance + (0.0 if one_way else path_m * path_m / 3.0)
        fields = {
            "speed_mps": path_m / dt,
            "speed_variance_m2ps2": self._limits.mean_variance(doubt_m2 / (dt * dt), dt),
            "interval_s": dt,
        }
        return Measured(0.5 * (last_s + from_s), fields)
