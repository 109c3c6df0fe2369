"""Messages are encoded to bytes and decoded; any mistake in the bytes raises `Refused`."""

from __future__ import annotations

from typing import Any, TypeVar

import msgpack
from pydantic import BaseModel, ValidationError

from .message import Message

M = TypeVar("M", bound=Message)


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


def encode(message: Message) -> bytes:
    """A message as a msgpack map."""
    data: bytes = msgpack.packb(message.__dict__, default=_fields)
    return data


def decode(payload: bytes, schema: type[M]) -> M:
    """A msgpack map as a message of the given schema. Raises Refused (`undecodable` or `invalid`)."""
    try:
        fields = msgpack.unpackb(payload)
    except Exception as error:  # msgpack raises ValueError, StackError, ExtraData and more on garbage
        raise Refused("undecodable", f"not msgpack: {error or type(error).__name__}") from error
    return from_fields(fields, schema)


def from_fields(fields: object, schema: type[M]) -> M:
    """A decoded map as a message of the given schema. Raises Refused (`invalid`), naming the first bad field."""
    try:
        return schema.model_validate(fields)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        where = ".".join(str(part) for part in first["loc"]) or "message"
        raise Refused("invalid", f"{schema.SCHEMA}: {where}: {first['msg']}") from error
    except UnicodeEncodeError as error:  # only JSON can hold it
        raise Refused("invalid", f"{schema.SCHEMA}: a text with half of a surrogate pair") from error
    except RecursionError as error:
        raise Refused("invalid", f"{schema.SCHEMA}: nested too deeply") from error
