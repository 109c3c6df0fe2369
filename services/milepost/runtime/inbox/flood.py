"""Against floods: what comes of one key may neither fill a process's inbox nor take the time of the other keys."""

from __future__ import annotations

from collections import deque
from collections.abc import Mapping

from milepost.estimation.time_units import NS_PER_S
from milepost_schemas import Refused

# a process that was stopped for five seconds finds so much of a unit at 200 Hz; to refuse it all takes 20 ms
MOST_WAITING = 1000
# keys beyond these, which only a stranger can make, are counted as one
MOST_KEYS = 1024
# how much faster than expected a key may be, after a stall for a second at once, and the least that may always come
HEADROOM, LEAST_HZ = 10.0, 100.0
REMEMBERED = 1024


class Waiting:
    """How many messages of each key wait in an inbox; those beyond `MOST_WAITING` are dropped and counted.

    `enters` is called by network threads, a key's always by the same one, `leaves` by the thread that reads the inbox.
    """

    def __init__(self) -> None:
        self.dropped = 0
        self._came: dict[str, int] = {}
        self._left: dict[str, int] = {}

    def enters(self, key: str) -> bool:
        """Whether one more message of a key may wait."""
        came = self._came
        if key not in came and len(came) >= MOST_KEYS:
            key = ""
        count = came.get(key, 0)
        if count - self._left.get(key, 0) >= MOST_WAITING:
            self.dropped += 1
            return False
        came[key] = count + 1
        return True

    def leaves(self, key: str) -> None:
        """A message of a key has been taken."""
        if key not in self._came:
            key = ""
        self._left[key] = self._left.get(key, 0) + 1


class _Key:
    """What a key's messages were: the last ones, by their hashes, and how many more may come at once."""

    def __init__(self, at_ns: int, tokens: float) -> None:
        self.at_ns, self.tokens = at_ns, tokens
        self.seen: set[int] = set()
        self.order: deque[int] = deque()


class Gate:
    """Refuses what is repeated, and what comes faster than its stream can, before anything costly is done with it.

    `expected_hz` are the rates of the streams as the train file sets them, all units together.
    """

    def __init__(self, expected_hz: Mapping[str, float]) -> None:
        self._limits_hz = {stream: max(LEAST_HZ, HEADROOM * hz) for stream, hz in expected_hz.items()}
        self._keys: dict[str, _Key] = {}

    def refuse_repeated(self, key: str, payload: bytes) -> None:
        """Raise Refused (`duplicate`) for bytes that have passed before."""
        known = self._keys.get(self._place(key))
        if known is not None and hash(payload) in known.seen:
            raise Refused("duplicate", f"{key}: the same message came before")

    def pass_through(self, stream: str, key: str, payload: bytes, fields: object, now_ns: int) -> None:
        """Raise Refused (`flood`) for one message too many. `fields` are what its payload holds.

        What does not even have the head of a message is left to its schema, and takes nothing from the others.
        """
        if not (isinstance(fields, dict) and type(fields.get("instance")) is str and type(fields.get("sequence")) is int):
            return
        limit_hz, place = self._limits_hz.get(stream, LEAST_HZ), self._place(key)
        known = self._keys.get(place)
        if known is None:
            known = self._keys[place] = _Key(now_ns, limit_hz)
        known.tokens = min(limit_hz, known.tokens + (now_ns - known.at_ns) / NS_PER_S * limit_hz)
        known.at_ns = now_ns
        if known.tokens < 1.0:
            raise Refused("flood", f"{key}: more than {limit_hz:.0f} messages a second")
        known.tokens -= 1.0
        known.seen.add(hash(payload))
        known.order.append(hash(payload))
        if len(known.order) > REMEMBERED:
            known.seen.discard(known.order.popleft())

    def _place(self, key: str) -> str:
        return key if key in self._keys or len(self._keys) < MOST_KEYS else ""
