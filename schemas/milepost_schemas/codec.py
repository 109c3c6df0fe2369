"""Messages are encoded to bytes and decoded; any mistake in the bytes raises `Refused`."""

from __future__ import annotations

from typing import Any, TypeVar

import msgpack
from pydantic import BaseModel, ValidationError

from .message import Message, Part

P = TypeVar("P", bound=Part)


class Refused(ValueError):
    """A message is refused. `reason` is a short word for counting, `detail` a sentence for people."""

    def __init__(self, reason: str, detail: str) -> None:
        super().__init__(f"{reason}: {detail}")
        self.reason = reason
        self.detail = detail


def _fields(value: object) -> Any:
    # model_dump() copies everything first and takes four times as long
    if isinstance(value, BaseModel):
        return value.__dict__
    raise TypeError(f"cannot encode {type(value).__name__}")


def encode(message: Part) -> bytes:
    """A message as a msgpack map."""
    data: bytes = msgpack.packb(message.__dict__, default=_fields)
    return data


def decode(payload: bytes, schema: type[P]) -> P:
    """A msgpack map as a message of the given schema. Raises Refused (`undecodable` or `invalid`)."""
    return from_fields(unpack(payload), schema)


def unpack(payload: bytes) -> object:
    """What a payload holds, before anything is checked. Raises Refused (`undecodable`)."""
    try:
        return msgpack.unpackb(payload)
    except Exception as error:  # msgpack raises ValueError, StackError, ExtraData and more on garbage
        raise Refused("undecodable", f"not msgpack: {str(error) or type(error).__name__}") from error


def from_fields(fields: object, schema: type[P]) -> P:
    """A decoded map as a message of the given schema. Raises Refused (`invalid`), naming the first bad field."""
    try:
        return schema.model_validate(fields)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "message"
        raise Refused("invalid", f"{_name(schema)}: {where}: {first['msg']}") from error
    except UnicodeEncodeError as error:  # only JSON can hold it
        raise Refused("invalid", f"{_name(schema)}: a text with half of a surrogate pair") from error
    except RecursionError as error:
        raise Refused("invalid", f"{_name(schema)}: nested too deeply") from error


def _name(schema: type[Part]) -> str:
    return schema.SCHEMA if issubclass(schema, Message) else schema.__name__
