"""The contract of Milepost: messages, codec and stream table. A dispatch tool needs no other package of it."""

from .candidate import Candidate
from .codec import Refused, decode, encode, from_fields, unpack
from .estimate import AbsoluteFix, Estimate, Feedback, JudgedReading, LinearObservation
from .event_codes import EVENT_CODES, EventCode
from .fault import FaultCommand
from .health import Event, Health, Spread
from .hypotheses import Hypotheses, Hypothesis
from .message import COMMON_STATES, Gaussian, Message, Part
from .position_report import PositionReport
from .reading import BaliseTelegram, InertialReading, PositionReading, SpeedReading
from .snapshot import MOST_PARTS, SnapshotPart
from .state import BalisePassed, FusedState, SensorExcluded, SensorInUse, SimulationStart, Truth
from .streams import BY_NAME, HEARING_KEY, ROOT, STREAMS, Stream, alive_key, router_key, rpc_key, simulation_start_key

__all__ = [
    "BY_NAME",
    "COMMON_STATES",
    "EVENT_CODES",
    "HEARING_KEY",
    "MOST_PARTS",
    "ROOT",
    "STREAMS",
    "AbsoluteFix",
    "BalisePassed",
    "BaliseTelegram",
    "Candidate",
    "Estimate",
    "Event",
    "EventCode",
    "FaultCommand",
    "Feedback",
    "FusedState",
    "Gaussian",
    "Health",
    "Hypotheses",
    "Hypothesis",
    "InertialReading",
    "JudgedReading",
    "LinearObservation",
    "Message",
    "Part",
    "PositionReading",
    "PositionReport",
    "Refused",
    "SensorExcluded",
    "SensorInUse",
    "SimulationStart",
    "SnapshotPart",
    "SpeedReading",
    "Spread",
    "Stream",
    "Truth",
    "alive_key",
    "decode",
    "encode",
    "from_fields",
    "router_key",
    "rpc_key",
    "simulation_start_key",
    "unpack",
]
