"""What is in a sample: a message of its stream, or a reason to refuse it."""

from __future__ import annotations

from milepost_schemas import Message, Refused, from_fields, unpack

from ..bus import Received
from .flood import Gate


def open_message(received: Received, train: str, gate: Gate, now_ns: int) -> Message:
    """The message in a sample. Raises Refused for a wildcard key, a foreign schema, or a head that contradicts the key.

    `gate` refuses first, and at little cost, what comes too often.
    """
    stream, sample, key = received.stream, received.sample, received.key
    if "*" in key:
        raise Refused("wildcard_key", f"put on {key}")
    encoding = str(sample.encoding)
    if encoding.startswith("application/msgpack;") and encoding != stream.message.encoding():
        raise Refused("other_schema", f"{key}: {encoding}, expected {stream.message.encoding()}")
    payload = sample.payload.to_bytes()
    gate.refuse_repeated(key, payload)
    fields = unpack(payload)
    gate.pass_through(stream.name, key, payload, fields, now_ns)
    message: Message = from_fields(fields, stream.message)
    if message.train != train:
        raise Refused("other_train", f"{key}: says train {message.train}")
    if stream.key.endswith("{unit}") and not key.endswith(f"/{message.unit}"):
        raise Refused("other_unit", f"{key}: says unit {message.unit}")
    return message
