"""THE STREAM TABLE: what travels, on which key, how often, with what quality of service.

Liveness, recording, quality of service, JSON Schemas and contract tests derive from these rows: a new stream is a row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .estimate import AbsoluteFix, Estimate, Feedback
from .health import Event, Health
from .message import Message
from .reading import BaliseTelegram, InertialReading, PositionReading, SpeedReading
from .state import FusedState, Truth

ROOT = "milepost/v1"

Priority = Literal["real_time", "interactive_high", "data_high", "data", "background"]


@dataclass(frozen=True, slots=True)
class Stream:
    """One row of the table.

    `key` is below `milepost/v1/{train}/`. `rate_hz` None is event-driven. `cached` > 0 asks for a publisher that remembers
    so many messages and lets interrupted subscribers recover them. `recorded` goes into recordings.
    """

    name: str
    key: str
    message: type[Message]
    rate_hz: float | None
    priority: Priority
    cached: int
    recorded: bool
    purpose: str

    def key_for(self, train: str, unit: str = "*") -> str:
        """The full key of this stream for a train and a unit ('*' for any)."""
        return f"{ROOT}/{train}/{self.key.format(unit=unit)}"


STREAMS: tuple[Stream, ...] = (
    Stream(
        "speed_reading", "reading/{unit}", SpeedReading, 100.0, "interactive_high", 0, True, "speed from radar, loop or wheel"
    ),
    Stream(
        "position_reading", "reading/{unit}", PositionReading, 2.5, "interactive_high", 0, True, "position from a GNSS receiver"
    ),
    Stream(
        "inertial_reading",
        "reading/{unit}",
        InertialReading,
        20.0,
        "interactive_high",
        0,
        True,
        "specific force and turn rate from an inertial unit",
    ),
    Stream("balise_telegram", "reading/{unit}", BaliseTelegram, None, "interactive_high", 0, True, "a balise under the reader"),
    Stream(
        "estimate", "estimate/{unit}", Estimate, 100.0, "interactive_high", 0, True, "a local filter's belief and observations"
    ),
    Stream("fix", "fix/{unit}", AbsoluteFix, None, "interactive_high", 50, True, "an absolute position from a balise"),
    Stream("feedback", "feedback", Feedback, 50.0, "interactive_high", 50, True, "the fused state, back to the filters"),
    Stream("state", "state", FusedState, 50.0, "real_time", 50, True, "the product, for dispatch tools"),
    Stream("event", "event", Event, None, "data", 50, True, "what a person should read"),
    Stream("health", "health/{unit}", Health, 1.0, "background", 0, True, "how a process is doing"),
    Stream("truth", "@sim/truth", Truth, 50.0, "background", 0, True, "the simulated train, for comparison only"),
)

BY_NAME: dict[str, Stream] = {row.name: row for row in STREAMS}


def alive_key(train: str, unit: str = "*", instance: str = "*") -> str:
    """The liveliness token of one instance of one process."""
    return f"{ROOT}/{train}/alive/{unit}/{instance}"


def rpc_key(train: str, procedure: str, unit: str = "*") -> str:
    """A procedure that a process answers."""
    return f"{ROOT}/{train}/@rpc/{procedure}/{unit}"


def simulation_start_key(train: str) -> str:
    """Where `world` says when scenario time began and how fast it runs."""
    return f"{ROOT}/{train}/@sim/start"
