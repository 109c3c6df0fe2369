"""THE TABLE OF THREATS: EN 50159's seven, as what a man in the middle does to the payloads of one key."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable
from itertools import count
from typing import Any

import msgpack

from .relay import Tamper

REPEATED = 5
DELAY_S = 1.0
# within the horizon of five seconds, in which order does not count
SHUFFLED_S = 0.3
FOREIGN = "stranger"
# what a forger adds; the bank of hypotheses must treat it as a unit that lies
FORGED = {"speed_mps": 1.0, "position_m": 50.0, "latitude_deg": 0.001}
FORGED_MPS2, FORGED_VALUE = 0.5, 1.0

Sent = Iterable[tuple[float, bytes]]


def repetition() -> Tamper:
    """Each message, and the five before it again."""
    kept: deque[bytes] = deque(maxlen=REPEATED)

    def tamper(payload: bytes) -> Sent:
        again = [(0.0, old) for old in kept]
        kept.append(payload)
        return [(0.0, payload), *again]

    return tamper


def deletion() -> Tamper:
    """Nothing comes through."""
    return lambda _: ()


def insertion() -> Tamper:
    """Beside each message one of nobody's, from an instance that does not exist, about a moment in between."""

    def tamper(payload: bytes) -> Sent:
        return [(0.0, payload), (0.0, _changed(payload, instance=FOREIGN, unit=FOREIGN))]

    return tamper


def resequencing() -> Tamper:
    """Every second message comes after those that follow it."""
    number = count()
    return lambda payload: [(SHUFFLED_S * (next(number) % 2), payload)]


def corruption() -> Tamper:
    """In turn: a flipped bit in the middle, half the message, not a number, a text for a number."""
    number = count()

    def tamper(payload: bytes) -> Sent:
        match next(number) % 4:
            case 0:
                middle = len(payload) // 2
                return [(0.0, payload[:middle] + bytes([payload[middle] ^ 0x80]) + payload[middle + 1 :])]
            case 1:
                return [(0.0, payload[: len(payload) // 2])]
            case 2:
                return [(0.0, _changed(payload, measured_at_ns=float("nan")))]
            case _:
                return [(0.0, _changed(payload, sequence="one"))]

    return tamper


def delay() -> Tamper:
    """Each message a second late."""
    return lambda payload: [(DELAY_S, payload)]


def masquerade() -> Tamper:
    """A forger in the sender's name, who is always there first: right form, right instance, false content."""

    def tamper(payload: bytes) -> Sent:
        return [(0.0, _changed(payload, **_forged(msgpack.unpackb(payload)))), (0.0, payload)]

    return tamper


def _forged(message: dict[str, Any]) -> dict[str, Any]:
    """The fields of a message that a forger changes: a speed, a place, a force, or what a filter has observed."""
    out = {name: message[name] + size for name, size in FORGED.items() if message.get(name) is not None}
    if "specific_force_mps2" in message:
        forward, *others = message["specific_force_mps2"]
        out["specific_force_mps2"] = [forward + FORGED_MPS2, *others]
    if "observations" in message:
        out["observations"] = [{**each, "value": each["value"] + FORGED_VALUE} for each in message["observations"]]
    return out


def _changed(payload: bytes, **fields: Any) -> bytes:
    packed: bytes = msgpack.packb(msgpack.unpackb(payload) | fields)
    return packed


THREATS: dict[str, Callable[[], Tamper]] = {
    each.__name__: each for each in (repetition, deletion, insertion, resequencing, corruption, delay, masquerade)
}
