"""A part of a recording, from one time of receipt to another."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from milepost.config.errors import ConfigError

NS_PER_S = 1_000_000_000
END_OF_TIME_NS = 1 << 63


class Window(NamedTuple):
    """Times of receipt from `since_ns` to before `until_ns`, UTC."""

    since_ns: int = 0
    until_ns: int = END_OF_TIME_NS

    def holds(self, at_ns: int) -> bool:
        """Whether a message that came then is in it."""
        return self.since_ns <= at_ns < self.until_ns

    def misses(self, first_ns: int, last_ns: int) -> bool:
        """Whether nothing that came between these times is in it."""
        return last_ns < self.since_ns or first_ns >= self.until_ns


ALL = Window()


def window_of(files: Iterable[Path], since: str | None, until: str | None) -> Window:
    """The part of a recording between two times: in UTC, or in seconds after its first message. Raises ConfigError."""
    if since is None and until is None:
        return ALL
    begun_ns: int | None = None

    def at_ns(said: str | None, option: str, otherwise: int) -> int:
        nonlocal begun_ns
        if said is None:
            return otherwise
        seconds = _seconds(said)
        if seconds is None:
            return _utc_ns(said, option)
        if begun_ns is None:
            begun_ns = _begun_ns(files)
        return begun_ns + round(seconds * NS_PER_S)

    found = Window(at_ns(since, "--since", 0), at_ns(until, "--until", END_OF_TIME_NS))
    if found.until_ns <= found.since_ns:
        raise ConfigError("--until", "", f"{until} is not after --since {since}" if since else f"{until} is before all")
    return found


def _seconds(said: str) -> float | None:
    try:
        seconds = float(said)
    except ValueError:
        return None
    return seconds if 0.0 <= seconds < 1e9 else None


def _utc_ns(said: str, option: str) -> int:
    try:
        found = datetime.fromisoformat(said)
        at = found.replace(tzinfo=UTC) if found.tzinfo is None else found
        return round(at.timestamp() * 1e6) * 1000
    except (ValueError, OverflowError):
        expected = "UTC as in 2026-11-28T12:15:00, or seconds after the first message"
        raise ConfigError(option, "", f"must be {expected}, not {said!r}") from None


def outside(files: Iterable[Path], window: Window) -> str | None:
    """What to say where a window holds nothing of a recording: when that was; None where all is asked for, or it is empty."""
    from .reading import McapReader

    if window == ALL:
        return None
    first_ns, last_ns = END_OF_TIME_NS, 0
    for path in files:
        for message in McapReader(path).messages():
            first_ns, last_ns = min(first_ns, message.at_ns), max(last_ns, message.at_ns)
    if not last_ns:
        return None
    first, last = (datetime.fromtimestamp(ns / NS_PER_S, UTC).strftime("%Y-%m-%dT%H:%M:%S") for ns in (first_ns, last_ns))
    return (
        f"nothing came between these times: it was recorded from {first} to {last} UTC, {(last_ns - first_ns) / NS_PER_S:.1f} s"
    )


def _begun_ns(files: Iterable[Path]) -> int:
    from .reading import McapReader

    firsts = [next((message.at_ns for message in McapReader(path).messages()), None) for path in files]
    return min((first for first in firsts if first is not None), default=0)
