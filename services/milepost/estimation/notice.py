"""Notices of filters and observers, for people to read."""

from __future__ import annotations

from typing import Literal, NamedTuple


class Notice(NamedTuple):
    """A notice, which the node publishes as an event."""

    severity: Literal["info", "warning", "error"]
    code: str
    text: str
