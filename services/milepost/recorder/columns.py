"""The columns of a stream's table, from its schema: a field each, with its unit in its name; parts of parts joined by dots.

Lists and maps stay whole: as JSON in a text table, as lists and maps where the format has them.
"""

from __future__ import annotations

import types
from collections.abc import Iterator
from typing import Annotated, Any, Literal, NamedTuple, Union, get_args, get_origin

from pydantic import BaseModel

from milepost_schemas import Message

RECEIVED = "received_at_ns"


class Column(NamedTuple):
    """A column: its name, where its value stands in a message, and the type that the schema gives."""

    name: str
    path: tuple[str, ...]
    kind: Any

    def of(self, fields: dict[str, Any]) -> Any:
        """The value in a message; None where the part that has it is not there."""
        value: Any = fields
        for step in self.path:
            if not isinstance(value, dict):
                return None
            value = value.get(step)
        return value


def columns_of(message: type[Message]) -> list[Column]:
    """All columns of a message; first the receipt."""
    return [Column(RECEIVED, (RECEIVED,), int), *_columns(message, ())]


def _columns(part: type[BaseModel], above: tuple[str, ...]) -> Iterator[Column]:
    for name, field in part.model_fields.items():
        kind, path = plain(field.annotation), (*above, name)
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            yield from _columns(kind, path)
        else:
            yield Column(".".join(path), path, kind)


def plain(kind: Any) -> Any:
    """A type without its limits, and without None."""
    if get_origin(kind) is Annotated:
        return plain(get_args(kind)[0])
    if get_origin(kind) in (Union, types.UnionType):
        others = [each for each in get_args(kind) if each is not type(None)]
        return plain(others[0]) if len(others) == 1 else Any
    if get_origin(kind) is Literal:
        return type(get_args(kind)[0])
    return kind
