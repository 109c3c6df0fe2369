"""The recorders of several trains as one."""

from __future__ import annotations

from collections.abc import Mapping

from .incoming import Incoming
from .recorder import Recorder

# a disk takes some milliseconds for each file: at a check so many are waited for, in turn
MOST_SYNCED = 10


class Several:
    """Writes what comes to the recorder of its train. Whoever subscribes to no other train's keys gets no others."""

    def __init__(self, recorders: Mapping[str, Recorder]) -> None:
        self._recorders = recorders
        self._turn = 0

    def add(self, message: Incoming) -> None:
        """Write one message."""
        self._recorders[train_of(message.key)].add(message)

    def check(self, now_ns: int) -> None:
        """Have the system take what came, the disk that of the next few, and whatever else is due."""
        count = len(self._recorders)
        for place, recorder in enumerate(self._recorders.values()):
            recorder.check(now_ns, (place - self._turn) % count < MOST_SYNCED)
        self._turn = (self._turn + MOST_SYNCED) % count

    def close(self, now_ns: int) -> None:
        """Finish the files in hand."""
        for recorder in self._recorders.values():
            recorder.close(now_ns)


def train_of(key: str) -> str:
    """The train in a key below `milepost/v1`; empty where there is none."""
    words = key.split("/", 3)
    return words[2] if len(words) > 3 else ""
