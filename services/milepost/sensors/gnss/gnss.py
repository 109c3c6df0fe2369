"""GNSS receiver: latitude and longitude, projected on the line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cached_property

from milepost.estimation.layout import PrivateState
from milepost.recordings.measured import Source
from milepost_schemas import PositionReading

from ..base import Sensor, World
from ..observed import Belief, Observed
from .legs import Legs
from .observer import GnssObserver
from .options import GnssOptions
from .receiver import open_receiver
from .simulated import Figures, SimulatedReceiver


class Gnss(Sensor[GnssOptions]):
    """z = chainage of the nearest point of the track, h = [1, 0, 0, σ_o], R by solution or as stated.

    The projection depends on the line and the fix alone, so the observation is exactly linear. Where the line comes near
    itself, the belief decides to which part of it a fix belongs, and nothing else: the row stays as it is.
    The private state is the slow offset along the track in units of σ_o, that solution's figure, so that a change of
    solution changes its size. Speed: z = v cos(course - heading), h = [0, 1, 0, 0], which is negative where the train goes
    towards lower chainage; a speed without a course has no sign and counts only near standstill, as 0 ± √(v² + σ_v²).
    """

    kind = "gnss"
    stream = "position_reading"
    options_model = GnssOptions
    fault_probability = 3e-3

    @property
    def never_repeats(self) -> bool:
        """Fixes are noisy to the last digit."""
        return True

    @property
    def private_states(self) -> tuple[PrivateState, ...]:
        """The offset, where a solution has one."""
        if not self.options.offset_std_m:
            return ()
        tau = self.options.offset_time_s
        return (PrivateState("offset", 0.0, 1.0, tau, 2.0 / tau),)

    @property
    def needs_belief(self) -> bool:
        """Where the line comes near itself."""
        return self._legs is not None

    @cached_property
    def _legs(self) -> Legs | None:
        """The parts of a line that comes near itself. Found out once: it takes milliseconds."""
        options, track = self.options, self.line.track
        if track is None:
            return None
        stds = [math.hypot(std, options.offset_std_m.get(name, 0.0)) for name, std in options.position_std_m.items()]
        legs = Legs(track, max(map(options.limits.farthest_m, stds), default=options.cross_track_limit_m))
        return legs if legs.exist() else None

    @property
    def period_s(self) -> float:
        """One fix each 1/rate."""
        return 1.0 / self.options.rate_hz

    def observe(self, reading: PositionReading, belief: Belief | None) -> Sequence[Observed]:
        """The fix judged by itself; `observer()` remembers the ones before it."""
        return self.observer().observe(reading, belief)

    def observer(self) -> GnssObserver:
        """Who judges the fixes one after the other."""
        return GnssObserver(self.unit, self.options, self.line.track, self._legs, len(self.private_states))

    def open(self, world: World | None, from_s: float) -> Source:
        """The fixes of a receiver, or simulated ones."""
        options = self.options
        if options.source == "receiver":
            if options.receiver is None:
                raise ValueError(f"{self.unit}: `source: receiver` needs a `receiver`")
            return open_receiver(options.receiver, from_s)
        world = self.needed(world)
        figures = Figures(options.position_std_m, options.offset_std_m, options.offset_time_s, options.speed_std_mps)
        return SimulatedReceiver(self.unit, options.rate_hz, figures, options.simulated, world, from_s)
