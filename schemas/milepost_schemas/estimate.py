"""The messages between filters, the balise service and the fuser."""

from __future__ import annotations

from typing import Annotated, Any, ClassVar

from pydantic import Field, model_validator

from .message import Count, Gaussian, Message, Name, NonNegative, Part, PositionM, Share, TimeNs, Variance

Coefficient = Annotated[float, Field(ge=-1e6, le=1e6)]


class LinearObservation(Part):
    """One scalar observation z = h x + e, e ~ N(0, R), over [s, v, a, the unit's private states].

    `row` is h, `value` is z, `variance` is R. The unit, `measured_at_ns` and `component` are its identity: repeated, it
    counts once, also under another instance.
    """

    sensor_instance: Name
    reading_sequence: Count
    component: Count = 0
    measured_at_ns: TimeNs
    row: Annotated[list[Coefficient], Field(min_length=3)]
    value: Annotated[float, Field(ge=-1e9, le=1e9)]
    variance: Variance


class JudgedReading(Part):
    """A whole reading, which the fuser can linearise and judge by itself, and the filter's judgement of it.

    `fields` are the reading's own, by the schema of the unit's sensor. `counts`: whether the filter lets it count; `why` not,
    where it does not; `gating`: whether it lets none count for the time being.
    """

    sensor_instance: Name
    reading_sequence: Count
    measured_at_ns: TimeNs
    fields: dict[str, Any]
    counts: bool
    why: str | None = None
    gating: bool = False


class Estimate(Message):
    """A local filter's belief at `measured_at_ns` and the linearised observations of the readings that are new in it.

    The rows of linear sensors with plain filters depend on the reading alone. Rows that are linearised, judged or weighted at
    the filter's belief depend on the feedback in it: of those `readings` has what the sensor stated, so that the fuser can
    linearise, judge and learn the variance by itself; the rows then tell what the filter made of it.
    `feedback_epoch_ns` is the epoch of the last feedback that the belief contains.
    """

    SCHEMA: ClassVar[str] = "estimate"

    belief: Gaussian
    observations: list[LinearObservation]
    readings: list[JudgedReading] = Field(default_factory=list)
    feedback_epoch_ns: TimeNs | None = None


class AbsoluteFix(Message):
    """The train's reference point was at `position_m` at `measured_at_ns`.

    `reader`, `reader_instance` and `reading_sequence` identify the reading; `location_accuracy_m` is the accuracy of
    the balise's position on the line. `doubtful`: why the balise was not expected there and then; None where it was.
    """

    SCHEMA: ClassVar[str] = "absolute_fix"

    reader: Name
    reader_instance: Name
    reading_sequence: Count
    balise_id: Name
    position_m: PositionM
    position_variance_m2: Variance
    location_accuracy_m: NonNegative
    doubtful: str | None = None


class Feedback(Message):
    """The fused state at epoch `measured_at_ns` over all states, and the share (beta) of every reporting unit.

    `position_min_m` to `speed_max_mps`: the interval that is published in the state of this epoch.
    """

    SCHEMA: ClassVar[str] = "feedback"

    fused: Gaussian
    shares: dict[str, Share]
    position_min_m: float | None = None
    position_max_m: float | None = None
    speed_min_mps: float | None = None
    speed_max_mps: float | None = None

    @property
    def interval(self) -> tuple[float, float, float, float] | None:
        """The bounds of position and speed, least and greatest; None where one is not stated."""
        low, high, slow, fast = self.position_min_m, self.position_max_m, self.speed_min_mps, self.speed_max_mps
        return None if low is None or high is None or slow is None or fast is None else (low, high, slow, fast)

    @model_validator(mode="after")
    def _least_before_greatest(self) -> Feedback:
        for name, low, high in (
            ("position", self.position_min_m, self.position_max_m),
            ("speed", self.speed_min_mps, self.speed_max_mps),
        ):
            if low is not None and high is not None and low > high:
                raise ValueError(f"the {name} interval ends before it begins")
        return self
