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
from .streams import BY_NAME, ROOT, STREAMS, Stream, alive_key, rpc_key, simulation_start_key

__all__ = [
    "BY_NAME",
    "COMMON_STATES",
    "ROOT",
    "STREAMS",
    "AbsoluteFix",
    "BalisePassed",
    "BaliseTelegram",
    "Candidate",
    "Estimate",
    "EVENT_CODES",
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
    "MOST_PARTS",
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
    "rpc_key",
    "simulation_start_key",
    "unpack",
]
