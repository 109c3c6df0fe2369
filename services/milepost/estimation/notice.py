"""What a filter or an observer of a sensor wants a person to read."""

from __future__ import annotations

from typing import Literal, NamedTuple


class Notice(NamedTuple):
    """Something that happened: the node makes an event of it."""

    severity: Literal["info", "warning", "error"]
    code: str
    text: str
