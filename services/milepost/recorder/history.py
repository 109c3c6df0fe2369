"""What was said lately, for whoever comes late: the newest message of a stream, and those of the last minutes."""

from __future__ import annotations

import threading
from collections import deque

from .incoming import Incoming

NS_PER_S = 1_000_000_000
# the streams that answer, and for how long back
STREAMS = ("state", "event")
KEPT_S = 300.0
MOST_BYTES = 64 << 20


class BadQuestionError(ValueError):
    """A question that cannot be answered, and why."""


class History:
    """The messages of one key, each for `KEPT_S`; the newest for ever. One thread adds, others may ask."""

    def __init__(self, kept_s: float = KEPT_S, most_bytes: int = MOST_BYTES) -> None:
        self._kept_ns = round(kept_s * NS_PER_S)
        self._most = most_bytes
        self._bytes = 0
        self._messages: deque[Incoming] = deque()
        self._lock = threading.Lock()

    def add(self, message: Incoming) -> None:
        """Keep a message, and drop what is too old or too much."""
        with self._lock:
            self._messages.append(message)
            self._bytes += len(message.payload)
            oldest_ns = message.at_ns - self._kept_ns
            while len(self._messages) > 1 and (self._messages[0].at_ns < oldest_ns or self._bytes > self._most):
                self._bytes -= len(self._messages.popleft().payload)

    def answer(self, seconds: float | None, now_ns: int) -> list[Incoming]:
        """The newest message, or those of the last so many seconds, oldest first."""
        with self._lock:
            messages = list(self._messages)
        if seconds is None:
            return messages[-1:]
        since_ns = now_ns - round(seconds * NS_PER_S)
        return [message for message in messages if message.at_ns >= since_ns]


def seconds_asked_for(parameters: str) -> float | None:
    """The value of `seconds` in a selector's parameters, as in `seconds=60`; None without. Raises BadQuestionError.

    Zenoh's own parameters begin with an underline.
    """
    found = dict(word.partition("=")[::2] for word in parameters.split(";") if word and not word.startswith("_"))
    if unknown := found.keys() - {"seconds"}:
        raise BadQuestionError(f"{min(unknown)}: no such parameter; there is seconds: how far back")
    said = found.get("seconds")
    if said is None:
        return None
    try:
        seconds = float(said)
    except ValueError:
        raise BadQuestionError(f"seconds: a number, not {said!r}") from None
    if not 0.0 < seconds <= KEPT_S:
        raise BadQuestionError(f"seconds: more than 0 and at most {KEPT_S:g}, not {said}")
    return seconds
