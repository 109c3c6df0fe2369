"""What a fuser hands over to a replica that was restarted."""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from .message import Part, TimeNs

MOST_PARTS = 1024


class SnapshotPart(Part):
    """One part of `parts`, from 0, of all that a fuser knew at `taken_at_ns`.

    `fingerprint` is that of its settings and code: `content` has a meaning for a replica of the same fingerprint alone, and is
    no contract between versions.
    """

    fingerprint: str
    taken_at_ns: TimeNs
    part: Annotated[int, Field(ge=0, lt=MOST_PARTS)]
    parts: Annotated[int, Field(ge=1, le=MOST_PARTS)]
    content: bytes
