"""What waits to be written: bounded, so that a slow disk costs messages, which are counted, and never the memory."""

from __future__ import annotations

import queue
import threading
from typing import Any, NamedTuple

from milepost.recorder.several import train_of

from ..inbox.taking import take

MOST_BYTES = 64 << 20
# one key must not take the room of all others
MOST_OF_A_KEY_BYTES = MOST_BYTES // 4
# what a waiting sample takes beside its payload
EACH_BYTES = 1024
MOST_KEYS = 4096


class Waiting(NamedTuple):
    """A sample as it came, with its key and the time of its receipt."""

    key: str
    at_ns: int
    sample: Any
    size: int


class Intake:
    """A queue between the network's threads, which never wait, and the thread that writes."""

    def __init__(
        self, most_bytes: int = MOST_BYTES, most_of_a_key_bytes: int = MOST_OF_A_KEY_BYTES, most_keys: int = MOST_KEYS
    ) -> None:
        self._most = most_bytes
        self._most_of_a_key = most_of_a_key_bytes
        self._most_keys = most_keys
        self._queue: queue.SimpleQueue[Any] = queue.SimpleQueue()
        self._lock = threading.Lock()
        self._bytes = 0
        self._of_key: dict[str, int] = {}
        self._lost: dict[str, int] = {}

    def put(self, key: str, at_ns: int, sample: Any) -> None:
        """A sample came; it waits, or is counted as lost where too much waits."""
        size = len(sample.payload) + EACH_BYTES
        with self._lock:
            place = key if key in self._of_key or len(self._of_key) < self._most_keys else ""
            of_key = self._of_key.get(place, 0) + size
            if self._bytes + size > self._most or of_key > self._most_of_a_key:
                train = train_of(key)
                self._lost[train] = self._lost.get(train, 0) + 1
                return
            self._bytes += size
            self._of_key[place] = of_key
        self._queue.put(Waiting(key, at_ns, sample, size))

    @property
    def lost(self) -> int:
        """How many samples found no room."""
        return sum(list(self._lost.values()))

    def lost_of(self, train: str) -> int:
        """How many of a train's samples found no room."""
        return self._lost.get(train, 0)

    def tell(self, command: Any) -> None:
        """Hand the writing thread something that is no sample; there is always room for it."""
        self._queue.put(command)

    def get(self, timeout_s: float) -> Any:
        """The next sample or command. Raises queue.Empty."""
        item = take(self._queue, timeout_s)
        if isinstance(item, Waiting):
            with self._lock:
                self._bytes -= item.size
                place = item.key if item.key in self._of_key else ""
                self._of_key[place] -= item.size
        return item
