"""The recorders of several trains as one."""

from __future__ import annotations

from collections.abc import Mapping

from .incoming import Incoming
from .recorder import Recorder

# to end a chunk costs as much as some messages: each file is handed over at every other check
SHARES = 2
# a disk takes some milliseconds for each file: at a check so many are waited for, in turn
MOST_SYNCED = 10


class Several:
    """Writes what comes to the recorder of its train. Only messages of its trains are to come."""

    def __init__(self, recorders: Mapping[str, Recorder]) -> None:
        self._recorders = recorders
        shares = 1 if len(recorders) == 1 else SHARES
        self._shares = [list(recorders.values())[share::shares] for share in range(shares)]
        self._checks = 0

    def add(self, message: Incoming) -> None:
        """Write one message."""
        self._recorders[train_of(message.key)].add(message)

    def check(self, now_ns: int) -> None:
        """Have the system take what came for one share of the trains, and the disk that of some; and whatever else is due."""
        rounds, share = divmod(self._checks, len(self._shares))
        recorders = self._shares[share]
        first = rounds * MOST_SYNCED
        for place, recorder in enumerate(recorders):
            recorder.check(now_ns, (place - first) % len(recorders) < MOST_SYNCED)
        self._checks += 1

    def close(self, now_ns: int) -> None:
        """Finish the files in hand."""
        for recorder in self._recorders.values():
            recorder.close(now_ns)


def train_of(key: str) -> str:
    """The train in a key below `milepost/v1`; empty where there is none."""
    words = key.split("/", 3)
    return words[2] if len(words) > 3 else ""
