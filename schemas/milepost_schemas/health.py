"""Health and events of the processes."""

from __future__ import annotations

from typing import ClassVar, Literal

from pydantic import Field

from .message import Count, Message, NonNegative, Part


class Spread(Part):
    """Median, 99th percentile and maximum of a quantity over the last period."""

    p50: float
    p99: float
    max: float


class Health(Message):
    """Once a second, of every process: what came in and went out, what was refused and why, how long a step took.

    Rates are by stream, over all units that send on it. `expected_hz` is the least rate that the train file sets for a stream
    that the process receives or sends; what has no rate of its own (pulses, balises) adds nothing to it.
    """

    SCHEMA: ClassVar[str] = "health"

    uptime_s: NonNegative
    received_hz: dict[str, NonNegative]
    sent_hz: dict[str, NonNegative]
    expected_hz: dict[str, NonNegative] = Field(default_factory=dict)
    refused: dict[str, Count]
    rewinds: Count
    gaps: Count
    step_us: Spread | None = None
    latency_ms: Spread | None = None


class Event(Message):
    """An event, for people to read."""

    SCHEMA: ClassVar[str] = "event"

    severity: Literal["info", "warning", "error"]
    code: str
    text: str
