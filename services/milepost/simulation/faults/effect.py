"""The effect of a fault: a pure function of a reading, its time, the readings before it, and the unit's surroundings."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from pydantic import BaseModel

from milepost.track.line import Line
from milepost_schemas import Message

from ..motion import Motion

HEAD = tuple(Message.model_fields)


@dataclass(frozen=True)
class Surroundings:
    """What a unit's faults depend on besides its readings: its stream and kind of sensor, and where it is.

    `motion`: the true one, None where there is no truth. `seed`: of noise. `position_std_m` by solution and
    `force_noise_mps2_rthz`: the unit's noise where its readings do not state it.
    """

    unit: str
    stream: str
    sensor: str
    line: Line
    motion: Motion | None = None
    seed: int = 0
    position_std_m: Mapping[str, float] = field(default_factory=dict)
    force_noise_mps2_rthz: float | None = None


@dataclass(frozen=True)
class Moment:
    """When a reading is true, in scenario time, and what came before it.

    The fault acts from `from_s` to `to_s`. `count`: readings that it has acted on already. `onset`: the last honest reading
    before the fault, or the first one in it. `earlier`: honest readings, oldest first, this one last.
    """

    t_s: float
    from_s: float
    to_s: float
    count: int
    onset: Any
    earlier: Sequence[Any]
    around: Surroundings

    @property
    def since_s(self) -> float:
        """Seconds since the fault began."""
        return self.t_s - self.from_s


class Sent(NamedTuple):
    """A message on its way out, and how much later than the honest one it is sent."""

    message: Message
    delay_s: float = 0.0


# (options, moment, reading) -> what is sent in its place
Effect = Callable[[Any, Moment, Any], list[Sent]]


@dataclass(frozen=True)
class FaultKind:
    """A row of the table of faults.

    `streams`: the streams of readings that it fits; `sensors`: the kinds of sensor, where not every one with such a stream.
    `needs_motion`: it needs the true motion. `passes_over`: whether it does not act on a reading.
    """

    name: str
    purpose: str
    options: type[BaseModel]
    effect: Effect
    streams: tuple[str, ...]
    sensors: tuple[str, ...] = ()
    needs_motion: bool = False
    passes_over: Callable[[Any, int, Any], bool] | None = None


def with_content_of(content: Any, head: Message, **changed: Any) -> Any:
    """A message with the content of one reading and the head of another."""
    return content.model_copy(update={**{name: getattr(head, name) for name in HEAD}, **changed})
