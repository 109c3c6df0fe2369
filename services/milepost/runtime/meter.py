"""What a process counts about itself, for its health once a second."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from milepost_schemas import Message, Spread


class Meter:
    """Rates, gaps, step times and latencies since the last report. `expected_hz`: what the rates should be, by stream."""

    def __init__(self, now_ns: int, expected_hz: Mapping[str, float] | None = None) -> None:
        self._expected_hz = dict(expected_hz or {})
        self._begun_ns = now_ns
        self._since_ns = now_ns
        self._received: dict[str, int] = {}
        self._sent: dict[str, int] = {}
        self._steps_us: list[float] = []
        self._latencies_ms: list[float] = []
        self._next_sequence: dict[tuple[str, str, str], int] = {}
        self._gaps = 0

    def received(self, stream: str, message: Message, now_ns: int) -> None:
        """A message came. A jump in its sequence is a gap."""
        self._received[stream] = self._received.get(stream, 0) + 1
        self._latencies_ms.append((now_ns - message.published_at_ns) * 1e-6)
        source = (stream, message.unit, message.instance)
        expected = self._next_sequence.get(source)
        if expected is not None and message.sequence > expected:
            self._gaps += message.sequence - expected
        self._next_sequence[source] = max(message.sequence + 1, expected or 0)

    def sent(self, stream: str) -> None:
        """A message went."""
        self._sent[stream] = self._sent.get(stream, 0) + 1

    def stepped(self, seconds: float) -> None:
        """A step, with what it sent, took so long."""
        self._steps_us.append(seconds * 1e6)

    def report(self, now_ns: int, refused: dict[str, int], rewinds: int) -> dict[str, Any]:
        """The body of a health message, and a fresh start."""
        span = max((now_ns - self._since_ns) * 1e-9, 1e-3)
        body = {
            "uptime_s": (now_ns - self._begun_ns) * 1e-9,
            "received_hz": {name: count / span for name, count in self._received.items()},
            "sent_hz": {name: count / span for name, count in self._sent.items()},
            "expected_hz": self._expected_hz,
            "refused": refused,
            "rewinds": rewinds,
            "gaps": self._gaps,
            "step_us": _spread(self._steps_us),
            "latency_ms": _spread(self._latencies_ms),
        }
        self._since_ns = now_ns
        self._received, self._sent, self._steps_us, self._latencies_ms = {}, {}, [], []
        if len(self._next_sequence) > 1024:
            self._next_sequence.clear()
        return body


def _spread(values: list[float]) -> Spread | None:
    if not values:
        return None
    ordered = sorted(values)
    last = len(ordered) - 1
    return Spread(p50=ordered[last // 2], p99=ordered[round(last * 0.99)], max=ordered[-1])
