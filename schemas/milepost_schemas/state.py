"""The published state: the train's position and speed with confidence intervals."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, model_validator

from .message import AccelerationMps2, Count, Covariance, Message, Name, NonNegative, Part, PositionM, Share, SpeedMps, TimeNs

Status = Literal["initialising", "normal", "degraded", "coasting", "lost"]
# why a unit is not in use: first those that say nothing in time, then the one whose own filter lets nothing count, then those
# whose word is wrong
WorkingState = Literal[
    "absent",
    "silent",
    "late",
    "refused",
    "stuck",
    "out_of_range",
    "noisy",
    "biased",
    "drifting",
    "jumping",
    "slipping",
    "intermittent",
    "exceeded",
]
SAYS_NOTHING = frozenset({"absent", "silent", "late"})
Direction = Literal["forward", "backward", "standstill", "unknown"]


class SensorInUse(Part):
    """A unit in use at this epoch: its share and the age of its last observation."""

    unit: Name
    share: Share
    age_s: NonNegative


class SensorExcluded(Part):
    """A unit that is not in use at this epoch: the reason in words, and its kind.

    `kind` `absent` (no process, or never heard), `silent` or `late`: it says nothing in time; `refused`: its own filter lets no
    reading count; `exceeded`: the train moves harder than its `motion-model` says; any other: what it says is wrong. None: an
    older fuser does not tell.
    """

    unit: Name
    reason: str
    kind: WorkingState | None = None

    @property
    def says_nothing(self) -> bool:
        """Whether nothing is heard of it in time, rather than something that is not believed."""
        return self.kind in SAYS_NOTHING


class StateReset(Part):
    """A step of the state by more than its own uncertainty: how far, and why."""

    size_m: float
    size_mps: float
    reason: str


class BalisePassed(Part):
    """The last balise passed, its chainage and the distance travelled since."""

    balise_id: Name
    position_m: PositionM
    distance_since_m: float


class FusedState(Message):
    """The fused state at the epoch `measured_at_ns`.

    `covariance` is over [position m, speed m/s, acceleration m/s²]. The true position lies in
    [`position_min_m`, `position_max_m`], the true speed in [`speed_min_mps`, `speed_max_mps`]. `awaiting` lists units
    whose due reading had not arrived when it was sent; `settled` is true where the horizon has passed. The intervals hold the
    truth while any one unit lies; `position_accuracy_m` and `speed_accuracy_mps` are what holds for 95 % of all states if none
    does. `doubted` lists units that contradict each other while nothing tells which of them lies. `reset`: since the epoch
    before, the state stepped by more than its own uncertainty.
    """

    SCHEMA: ClassVar[str] = "state"

    epoch: Count
    position_m: PositionM
    speed_mps: SpeedMps
    acceleration_mps2: float
    covariance: Annotated[Covariance, Field(min_length=3, max_length=3)]
    position_min_m: float
    position_max_m: float
    speed_min_mps: float
    speed_max_mps: float
    position_accuracy_m: NonNegative = 0.0
    speed_accuracy_mps: NonNegative = 0.0
    direction: Direction
    status: Status
    line: Name
    line_hash: str
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    last_balise: BalisePassed | None = None
    sensors: list[SensorInUse]
    excluded: list[SensorExcluded]
    doubted: list[Name] = Field(default_factory=list)
    reset: StateReset | None = None
    awaiting: list[Name]
    settled: bool = False

    @property
    def said_wrong(self) -> frozenset[str]:
        """The units that are said to be wrong, not those that merely say nothing in time."""
        return frozenset(each.unit for each in self.excluded if not each.says_nothing)

    @model_validator(mode="after")
    def _inside_own_interval(self) -> FusedState:
        if not self.position_min_m <= self.position_m <= self.position_max_m:
            raise ValueError("position_m must lie in its interval")
        if not self.speed_min_mps <= self.speed_mps <= self.speed_max_mps:
            raise ValueError("speed_mps must lie in its interval")
        return self


class SimulationStart(Part):
    """`world`'s answer: scenario time 0 in UTC, how fast scenario time runs, and when it ends."""

    start_ns: TimeNs
    speed: Annotated[float, Field(gt=0.0, le=1000.0)]
    end_ns: TimeNs


class Truth(Message):
    """The simulated or replayed train's true motion, on a key to which no fuser subscribes."""

    SCHEMA: ClassVar[str] = "truth"

    position_m: PositionM
    speed_mps: SpeedMps
    acceleration_mps2: AccelerationMps2
