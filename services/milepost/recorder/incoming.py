"""A message as it came, and what its head says."""

from __future__ import annotations

from typing import NamedTuple

from milepost_schemas import Refused, unpack


class Incoming(NamedTuple):
    """A message as it came."""

    key: str
    encoding: str
    at_ns: int
    payload: bytes


class Head(NamedTuple):
    """What the head of a message says, as far as it is there: its instance, sequence number and time of publication."""

    instance: str | None
    sequence: int
    published_ns: int | None


def head_of(payload: bytes) -> Head:
    """The head of a payload; what is not a message of ours has none."""
    try:
        fields = unpack(payload)
    except Refused:
        return Head(None, 0, None)
    if not isinstance(fields, dict):
        return Head(None, 0, None)
    instance, sequence, published = fields.get("instance"), fields.get("sequence"), fields.get("published_at_ns")
    return Head(
        instance if isinstance(instance, str) else None,
        _whole(sequence) or 0,
        _whole(published),
    )


def _whole(value: object) -> int | None:
    return value if type(value) is int and 0 <= value < 1 << 63 else None
