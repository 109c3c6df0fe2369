"""Faults of when a reading is sent, how often, and how it is stamped; and of balise telegrams."""

from __future__ import annotations

from typing import Annotated, Any

from pydantic import Field

from milepost_schemas import BaliseTelegram
from milepost_schemas.message import Name

from ..motion import Motion, when_at
from .content import Options
from .effect import Moment, Sent

# a train that does not come to a moved balise within this reads nothing
LONGEST_WAIT_S = 60.0
# a clock that is farther off is found by its date
LONGEST_S = 3600.0


class Seconds(Options):
    """Of delay and late_stamp."""

    by_s: Annotated[float, Field(gt=0.0, le=LONGEST_S)] = Field(description="s")


class Step(Options):
    """Of clock_step."""

    by_s: Annotated[float, Field(ge=-LONGEST_S, le=LONGEST_S)] = Field(description="s; the clock is ahead where positive")


class Drift(Options):
    """Of clock_drift."""

    ppm: Annotated[float, Field(ge=-1e5, le=1e5)] = Field(description="µs a second; the clock is fast where positive")


class Duplicate(Options):
    """Of duplicate."""

    times: Annotated[int, Field(ge=1, le=100)] = Field(5, description="copies beside the reading itself")
    offset_ms: Annotated[float, Field(ge=-1e6, le=1e6)] = Field(
        0.0, description="each copy is stamped so much later than the one before it, ms"
    )


class OfBalise(Options):
    """Of missed_balise; the other faults of balises have it too."""

    balise: Name | None = Field(None, description="only telegrams of this balise")


class WrongBalise(OfBalise):
    """Of wrong_balise."""

    says: Name | None = Field(None, description="the id in the telegram; default: the next balise's")
    once: bool = Field(True, description="only the first telegram")


class MovedBalise(OfBalise):
    """Of moved_balise."""

    offset_m: float = Field(description="m by which the balise lies farther along the line than the map says")
    once: bool = Field(True, description="only the first telegram")


def drop_out(options: Any, now: Moment, reading: Any) -> list[Sent]:  # noqa: ARG001
    """Nothing."""
    return []


def delay(options: Seconds, now: Moment, reading: Any) -> list[Sent]:  # noqa: ARG001
    """The reading, stamped honestly and sent later."""
    return [Sent(reading, options.by_s)]


def duplicate(options: Duplicate, now: Moment, reading: Any) -> list[Sent]:  # noqa: ARG001
    """The reading, and copies of it under instances of their own."""
    step_ns = round(options.offset_ms * 1e6)
    return [Sent(reading)] + [
        Sent(
            reading.model_copy(
                update={"instance": f"{reading.instance}-copy{n}", "measured_at_ns": reading.measured_at_ns + n * step_ns}
            )
        )
        for n in range(1, options.times + 1)
    ]


def stamped_later(reading: Any, by_ns: int) -> Any:
    """A reading whose clock is ahead: both of its stamps are."""
    stamps = {"measured_at_ns": reading.measured_at_ns + by_ns, "published_at_ns": reading.published_at_ns + by_ns}
    return reading.model_copy(update=stamps)


def clock_step(options: Step, now: Moment, reading: Any) -> list[Sent]:  # noqa: ARG001
    return [Sent(stamped_later(reading, round(options.by_s * 1e9)))]


def clock_drift(options: Drift, now: Moment, reading: Any) -> list[Sent]:
    """A clock that is right at the onset and runs at another rate from then on."""
    return [Sent(stamped_later(reading, round(options.ppm * 1e3 * now.since_s)))]


def late_stamp(options: Seconds, now: Moment, reading: Any) -> list[Sent]:  # noqa: ARG001
    """A device that needs longer than it knows: the content is older than the stamp, and no stamp lies in the future."""
    return [Sent(stamped_later(reading, round(options.by_s * 1e9)), options.by_s)]


def other_telegram(options: OfBalise, count: int, telegram: BaliseTelegram) -> bool:
    """Whether a fault of balises leaves a telegram alone."""
    if options.balise is not None and telegram.balise_id != options.balise:
        return True
    return bool(getattr(options, "once", False)) and count > 0


def wrong_balise(options: WrongBalise, now: Moment, telegram: BaliseTelegram) -> list[Sent]:
    """The telegram with another balise's id."""
    said = options.says or _next_balise(now, telegram.balise_id)
    return [Sent(telegram.model_copy(update={"balise_id": said}))]


def _next_balise(now: Moment, balise_id: str) -> str:
    """The id of the next balise of the line; of the one before where there is none."""
    ids = [balise.balise_id for balise in now.around.line.balises]
    if balise_id not in ids or len(ids) < 2:
        return f"not-{balise_id}"[:63]
    here = ids.index(balise_id)
    return ids[here + 1] if here + 1 < len(ids) else ids[here - 1]


def moved_balise(options: MovedBalise, now: Moment, telegram: BaliseTelegram) -> list[Sent]:
    """The telegram as it would be read where the balise really lies, at the time when the train is there.

    s(t') = s(t) + offset. What would have been read earlier is stamped so, and sent when the honest telegram is.
    """
    motion = now.around.motion
    if motion is None:
        raise ValueError("needs the true motion")
    there_s = _when(motion, now.t_s, options.offset_m)
    if there_s is None:
        return []
    late_s = there_s - now.t_s
    moved = telegram.model_copy(update={"measured_at_ns": telegram.measured_at_ns + round(late_s * 1e9)})
    if late_s <= 0.0:
        return [Sent(moved)]
    return [Sent(moved.model_copy(update={"published_at_ns": telegram.published_at_ns + round(late_s * 1e9)}), late_s)]


def _when(motion: Motion, t_s: float, offset_m: float) -> float | None:
    to_s, from_s = min(motion.end_s, t_s + LONGEST_WAIT_S), max(0.0, t_s - LONGEST_WAIT_S)
    wanted_m = motion.at(t_s)[0] + offset_m
    return when_at(motion, wanted_m, t_s, to_s) if offset_m >= 0.0 else when_at(motion, wanted_m, from_s, t_s)
