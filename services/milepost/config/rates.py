"""The expected rates of a train's streams, by their pace in the stream table."""

from __future__ import annotations

from milepost.nodes.base import Node
from milepost_schemas import BY_NAME, Stream

from .roles import Role
from .train import Train


def expected_hz(train: Train, role: Role, unit: str, node: Node) -> dict[str, float]:
    """The least rate in Hz of each stream that a process sends or receives message by message; without streams of events."""
    streams = [(BY_NAME[name], unit) for name in role.sends(train, unit)]
    streams += [(BY_NAME[s.stream], s.unit) for s in node.subscriptions if not s.newest_only]
    rates = {stream.name: _rate_hz(train, stream, of) for stream, of in streams}
    return {name: rate for name, rate in rates.items() if rate > 0.0}


def _rate_hz(train: Train, stream: Stream, unit: str) -> float:
    """The rate of a stream in Hz, of one unit or ('*') summed over all; aperiodic units add nothing."""
    fusion = train.file.fusion
    epochs_hz = 1000.0 / fusion.period_ms
    if stream.paced_by == "unit":
        return sum(_unit_hz(train, name) for name in _senders(train, stream) if unit in ("*", name))
    if stream.paced_by == "feedback":
        return epochs_hz / fusion.feedback_every if fusion.feedback else 0.0
    if stream.name == "candidate" and unit == "*":
        return epochs_hz * fusion.replicas
    return {"epoch": epochs_hz, "second": 1.0, "event": 0.0}[stream.paced_by]


def _unit_hz(train: Train, unit: str) -> float:
    period_s = train.sensors[unit].period_s
    return 0.0 if period_s is None else 1.0 / period_s


def _senders(train: Train, stream: Stream) -> list[str]:
    if stream.name == "estimate":
        return train.fused_units
    return [unit for unit, sensor in train.sensors.items() if sensor.stream == stream.name]
