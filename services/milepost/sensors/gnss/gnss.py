"""GNSS receiver: latitude and longitude, projected on the line."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, get_args

from pydantic import Field, model_validator

from milepost.estimation.layout import PrivateState
from milepost.estimation.notice import Notice
from milepost.recordings.gnss_log import GnssLog
from milepost.recordings.measured import Source
from milepost.track.track import Track
from milepost_schemas import PositionReading
from milepost_schemas.reading import Solution

from ..base import Belief, Observed, Sensor, SensorOptions, World
from .fix_monitor import FixLimits, FixMonitor, SeenFix
from .receiver import ReceiverOptions, open_receiver
from .simulated import Figures, Options, SimulatedGnss, SimulatedReceiver, Std

# below this a course over ground says nothing
LEAST_COURSE_SPEED_MPS = 3.0
# of the Doppler speed of a receiver that states none, where it serves to check its fixes only
DEFAULT_SPEED_STD_MPS = 0.2


class MonitorOptions(Options):
    """Limits of `fix_monitor`, which says what each means."""

    coasting_s: Std = 5.0
    proof_s: Annotated[float, Field(ge=0.0)] = 6.0
    max_acceleration_mps2: Std = 5.0
    course_deg: Annotated[float, Field(gt=0.0, le=90.0)] = 20.0
    alone_above: Annotated[int, Field(ge=0)] = 10
    least: Annotated[int, Field(ge=0)] = 4
    poor_factor: Annotated[float, Field(ge=1.0)] = 2.0


class GnssOptions(SensorOptions):
    """`position_std_m`: standard deviation of one axis by solution; a solution that is not listed does not count.

    `offset_std_m`: the same of the slow part (atmosphere, multipath) with `offset_time_s`; the private state.
    `trust_stated_std`: take the fix's own standard deviation where the receiver states one. `speed_std_mps`: of its speed;
    without it its speed is not used. `cross_track_limit_m`: a fix farther from the track cannot be this train.
    """

    recording: GnssLog | None = None
    receiver: ReceiverOptions | None = None
    simulated: SimulatedGnss = Field(default_factory=SimulatedGnss)
    monitor: MonitorOptions = Field(default_factory=MonitorOptions)
    rate_hz: Annotated[float, Field(gt=0.0, le=100.0)] = 2.5
    position_std_m: dict[str, Std] = Field(default_factory=lambda: {"rtk_fixed": 0.1})
    offset_std_m: dict[str, Std] = Field(default_factory=dict)
    offset_time_s: Std = 60.0
    trust_stated_std: bool = False
    speed_std_mps: Std | None = None
    cross_track_limit_m: Std = 10.0

    @model_validator(mode="after")
    def _known_solutions(self) -> GnssOptions:
        wanted = {**self.offset_std_m}
        if self.source == "simulation":
            wanted[self.simulated.solution] = 0.0
            wanted |= {self.simulated.recovering: 0.0} if self.simulated.recovery_s else {}
        known = get_args(Solution)
        for solution in self.position_std_m:
            if solution not in known:
                raise ValueError(f"position_std_m: must be one of {', '.join(known)}, not {solution}")
        for solution in wanted:
            if solution not in self.position_std_m:
                raise ValueError(f"position_std_m: {solution} is missing")
        return self


class Gnss(Sensor[GnssOptions]):
    """z = chainage of the nearest point of the track, h = [1, 0, 0, σ_o], R by solution or as stated.

    The projection depends on the line and the fix alone, not on the belief, so the observation is exactly linear.
    The private state is the slow offset along the track in units of σ_o, that solution's figure, so that a change of
    solution changes its size. Speed: z = v cos(course - heading), h = [0, 1, 0, 0], which is negative where the train goes
    towards lower chainage; a speed without a course has no sign and counts only near standstill, as 0 ± √(v² + σ_v²).
    """

    kind = "gnss"
    stream = "position_reading"
    options_model = GnssOptions

    @property
    def private_states(self) -> tuple[PrivateState, ...]:
        """The offset, where a solution has one."""
        if not self.options.offset_std_m:
            return ()
        tau = self.options.offset_time_s
        return (PrivateState("offset", 0.0, 1.0, tau, 2.0 / tau),)

    @property
    def needs_belief(self) -> bool:
        """Never: see above."""
        return False

    @property
    def period_s(self) -> float:
        """One fix each 1/rate."""
        return 1.0 / self.options.rate_hz

    def observe(self, reading: PositionReading, belief: Belief | None) -> Sequence[Observed]:
        """The fix judged by itself; `observer()` remembers the ones before it."""
        return self.observer().observe(reading, belief)

    def observer(self) -> GnssObserver:
        """Who judges the fixes one after the other."""
        return GnssObserver(self.unit, self.options, self.line.track, len(self.private_states))

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


class GnssObserver:
    """Projects fixes on the track and lets the monitor say which of them count."""

    def __init__(self, unit: str, options: GnssOptions, track: Track | None, private: int) -> None:
        self._unit, self._options, self._track, self._private = unit, options, track, private
        limits = FixLimits(cross_track_m=options.cross_track_limit_m, **options.monitor.model_dump())
        self._monitor = FixMonitor(limits, options.position_std_m)
        self._notices: list[Notice] = []

    def notices(self) -> list[Notice]:
        """When the receiver lost its credit and when it earned it back."""
        notices, self._notices = self._notices, []
        return notices

    def restarted(self) -> None:
        """It may have been in the middle of a tunnel: RTK has to prove itself."""
        self._monitor.doubt()

    @property
    def is_gating(self) -> bool:
        """Never: what it takes of a fix does not go by the fused state."""
        return False

    def observe(self, reading: PositionReading, belief: Belief | None) -> Sequence[Observed]:  # noqa: ARG002
        """The projected fix and the speed along the track, where they count."""
        if self._track is None:
            return ()
        options, solution = self._options, reading.solution
        seen = self._track.project(reading.latitude_deg, reading.longitude_deg)
        std = options.position_std_m.get(solution, math.inf)
        if options.trust_stated_std and reading.horizontal_std_m is not None and solution in options.position_std_m:
            std = reading.horizontal_std_m
        offset_std = options.offset_std_m.get(solution, 0.0)
        speed, turned = self._along(reading, seen.position_m)
        fix = SeenFix(
            reading.measured_at_ns * 1e-9,
            solution,
            seen.position_m,
            seen.cross_track_m,
            math.hypot(std, offset_std),
            reading.satellites,
            None if speed is None else speed.value,
            turned,
        )
        suspect = self._monitor.suspect
        refused, factor = self._monitor.judge(fix)
        self._tell(suspect, refused)
        if refused is not None:
            return ()
        if not (options.trust_stated_std and reading.horizontal_std_m is not None):
            std *= factor
        own = (offset_std,) * self._private
        place = Observed((1.0, 0.0, 0.0, *own), seen.position_m, std * std)
        return (place,) if speed is None or options.speed_std_mps is None else (place, speed)

    def _along(self, reading: PositionReading, position_m: float) -> tuple[Observed | None, float | None]:
        """The speed along the track as an observation, and by how much the course is turned from the track."""
        if reading.speed_mps is None or self._track is None:
            return None, None
        std = reading.speed_std_mps or self._options.speed_std_mps or DEFAULT_SPEED_STD_MPS
        row = (0.0, 1.0, 0.0) + (0.0,) * self._private
        if reading.course_deg is None:
            if reading.speed_mps > 3.0 * std:
                return None, None
            return Observed(row, 0.0, reading.speed_mps**2 + std * std), None
        turned = reading.course_deg - self._track.heading_deg(position_m)
        along = Observed(row, reading.speed_mps * math.cos(math.radians(turned)), std * std)
        return along, turned if reading.speed_mps > LEAST_COURSE_SPEED_MPS else None

    def _tell(self, suspect: bool, refused: str | None) -> None:
        if self._monitor.suspect and not suspect:
            reason = "its fixes jump" if refused == "jump" else "it has coasted for long"
            self._notices.append(Notice("warning", "gnss_not_trusted", f"{self._unit}: {reason}: RTK has to prove itself"))
        elif suspect and not self._monitor.suspect:
            self._notices.append(Notice("info", "gnss_trusted_again", f"{self._unit}: RTK has proved itself"))
