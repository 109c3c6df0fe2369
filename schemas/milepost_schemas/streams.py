"""THE STREAM TABLE: each stream's message, key, pace and quality of service.

Keys, quality of service, the expected rates in `health`, JSON Schemas and contract tests derive from these rows: a new
stream is a row.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from .candidate import Candidate
from .estimate import AbsoluteFix, Estimate, Feedback
from .fault import FaultCommand
from .health import Event, Health
from .hypotheses import Hypotheses
from .message import Message
from .position_report import PositionReport
from .reading import BaliseTelegram, InertialReading, PositionReading, SpeedReading
from .state import FusedState, Truth

ROOT = "milepost/v1"

# What sets a stream's rate: the period of the unit in the train file; the epochs (`fusion.period_ms`); every so many epochs
# (`fusion.feedback_every`); the clock, once a second; or nothing, where messages come as things happen.
Pace = Literal["unit", "epoch", "feedback", "second", "event"]
Priority = Literal["real_time", "interactive_high", "data_high", "data", "background"]
# a few numbers and names take some 300 bytes
SMALL = 4096


@dataclass(frozen=True, slots=True)
class Stream:
    """One row of the table.

    `key` is below `milepost/v1/{train}/`. `cached` > 0 asks for a publisher that remembers so many messages; subscribers
    recover what an interruption lost of them where the stream is paced by events. Routers drop what is larger than
    `largest_bytes`. A recorder writes what is `recorded`.
    """

    name: str
    key: str
    message: type[Message]
    paced_by: Pace
    priority: Priority
    cached: int
    purpose: str
    # the fused state of a train with a hundred private states, three times over
    largest_bytes: int = 262_144
    recorded: bool = True

    def key_for(self, train: str, unit: str = "*") -> str:
        """The full key of this stream for a train and a unit ('*' for any)."""
        return f"{ROOT}/{train}/{self.key.format(unit=unit)}"


STREAMS: tuple[Stream, ...] = (
    Stream(
        "speed_reading", "reading/{unit}", SpeedReading, "unit", "interactive_high", 0, "speed from radar, loop or wheel", SMALL
    ),
    Stream("position_reading", "reading/{unit}", PositionReading, "unit", "interactive_high", 0, "position from GNSS", SMALL),
    Stream(
        "inertial_reading",
        "reading/{unit}",
        InertialReading,
        "unit",
        "interactive_high",
        0,
        "specific force and turn rate from an inertial unit",
        SMALL,
    ),
    Stream(
        "balise_telegram", "reading/{unit}", BaliseTelegram, "event", "interactive_high", 0, "a balise under the reader", SMALL
    ),
    Stream("estimate", "estimate/{unit}", Estimate, "unit", "interactive_high", 0, "a local filter's belief and observations"),
    Stream("fix", "fix/{unit}", AbsoluteFix, "event", "interactive_high", 50, "an absolute position from a balise", SMALL),
    Stream("feedback", "feedback", Feedback, "feedback", "interactive_high", 50, "the fused state, back to the filters"),
    # not recorded: three times as much as `state`; a fuser makes them again from the recorded estimates
    Stream(
        "candidate",
        "candidate/{unit}",
        Candidate,
        "epoch",
        "real_time",
        0,
        "what one of three fusers would publish",
        recorded=False,
    ),
    Stream("state", "state", FusedState, "epoch", "real_time", 50, "the product, for dispatch tools"),
    Stream(
        "hypotheses", "hypotheses/{unit}", Hypotheses, "second", "data", 0, "which units may lie, and where the train then is"
    ),
    Stream("position_report", "position_report", PositionReport, "event", "data", 0, "packet 0 of ERTMS/ETCS", SMALL),
    Stream("event", "event", Event, "event", "data", 50, "what a person should read"),
    Stream("health", "health/{unit}", Health, "second", "background", 0, "how a process is doing"),
    Stream("chaos", "@chaos/{unit}", FaultCommand, "event", "data", 0, "what makes a simulated unit's sensor lie"),
    Stream("truth", "@sim/truth", Truth, "epoch", "background", 0, "the simulated train, for comparison only"),
)

BY_NAME: dict[str, Stream] = {row.name: row for row in STREAMS}


# nobody's token: who asks for it hears from its router that there is none
HEARING_KEY = f"{ROOT}/@hearing"


def alive_key(train: str, unit: str = "*", instance: str = "*") -> str:
    """The liveliness token of one instance of one process."""
    return f"{ROOT}/{train}/alive/{unit}/{instance}"


def rpc_key(train: str, procedure: str, unit: str = "*") -> str:
    """A procedure that a process answers."""
    return f"{ROOT}/{train}/@rpc/{procedure}/{unit}"


def router_key(zenoh_id: str) -> str:
    """The liveliness token of a router, by its Zenoh id ('*' for any)."""
    return f"{ROOT}/@router/{zenoh_id}"


def simulation_start_key(train: str) -> str:
    """The key on which `world` answers with the start and speed of scenario time."""
    return f"{ROOT}/{train}/@sim/start"
