"""What a key and an encoding say of a message: its train, its unit and its row of the stream table."""

from __future__ import annotations

from functools import lru_cache
from typing import NamedTuple

from milepost_schemas import ROOT, STREAMS, Stream

MSGPACK = "application/msgpack"


class Place(NamedTuple):
    """The parts of a key: the train, what follows it, and the last word of that."""

    train: str
    path: str
    unit: str


def place_of(key: str) -> Place | None:
    """The parts of a key below `milepost/v1/{train}/`; None for any other."""
    parts = key.split("/")
    if "/".join(parts[:2]) != ROOT or len(parts) < 4:
        return None
    return Place(parts[2], "/".join(parts[3:]), parts[-1])


def rows_of(path: str) -> list[Stream]:
    """The rows of the stream table whose key this can be; several, as all readings share one."""
    last = path.rpartition("/")[2]
    return [row for row in STREAMS if row.key.format(unit=last) == path]


# a fleet has some thousand keys, and a message of each every second
@lru_cache(maxsize=16384)
def row_of(key: str, encoding: str) -> Stream | None:
    """The row of a message by its key and encoding; None where it is none, or nothing tells which of several."""
    place = place_of(key)
    rows = rows_of(place.path) if place else []
    said = [row for row in rows if row.message.encoding() == encoding]
    if said or encoding.startswith(f"{MSGPACK};"):
        return said[0] if said else None
    return rows[0] if len(rows) == 1 else None


def recorded_keys(train: str) -> list[str]:
    """The key expressions of all recorded streams, each once."""
    return list(dict.fromkeys(row.key_for(train) for row in STREAMS if row.recorded))
