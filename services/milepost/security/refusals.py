"""Who was refused by a router, read from its log: Zenoh says it nowhere else.

Connections that fail are warnings. What access control refuses is traced, among all that it allows; and when Zenoh sees a key
for the first time it also traces, in nine lines, what would be refused. Those nine are left out here.
"""

from __future__ import annotations

import re
import time
from collections.abc import Callable
from dataclasses import dataclass

LOG_FILTER = "error,zenoh_link_tls=warn,zenoh::net::routing::interceptor::access_control=trace"
SAY_EVERY_S = 10.0
# whoever sends on ever new keys must not fill the memory, nor hide what others do
MOST_OF_ONE, MOST_NAMES = 16, 256
FURTHER = ("use", "further keys")
# what access control calls it
VERBS = {
    "Put": "put",
    "Delete": "delete",
    "Declare Subscriber": "subscribe to",
    "Declare Queryable": "offer answers on",
    "Query": "ask",
    "Reply": "answer on",
    "Liveliness Token": "show a token on",
    "Liveliness Query": "look for tokens on",
    "Declare Liveliness Subscriber": "watch tokens on",
}
ACTIONS = 9

_COLOUR = re.compile(r"\x1b\[[0-9;]*m")
_THREAD = r"ThreadId\((?P<thread>\d+)\)"
_CACHING = re.compile(_THREAD + r" .*ACL \((?P<flow>\w+)\): caching permissions for `(?P<key>[^`]*)`")
_ACTION = re.compile(
    rf"{_THREAD} .*: (?P<zid>[0-9a-f]+) on (?P<subject>\S+) is (?P<un>un)?authorized to (?P<what>[^(]+) "
    r"\((?P<flow>\w+)\) on (?P<key>\S+)"
)
_CACHED = re.compile(r"Using cached result: (?P<zid>[0-9a-f]+) is unauthorized to (?P<what>[^(]+) \(ingress\) on (?P<key>.+)")
_NAME = re.compile(r"CertCommonName\(([^)]*)\)")
_CONNECTION = re.compile(r" WARN .*zenoh_link_tls::\S+ (?P<why>.*?)\. Hint: ")

Refused = tuple[str, str, str]


@dataclass(slots=True)
class Count:
    """How often something was refused, and when that was last said."""

    total: int = 0
    said: int = 0
    said_s: float = 0.0


class Refusals:
    """Lines of a log in, sentences out. `tell` is called at the first refusal of its kind, then with sums every ten seconds."""

    def __init__(self, tell: Callable[[str, str], None], clock: Callable[[], float] = time.monotonic) -> None:
        self.counts: dict[Refused, Count] = {}
        self._tell = tell
        self._clock = clock
        self._names: dict[str, str] = {}
        self._kinds: dict[str, int] = {}
        # what a thread still traces of a key that it sees for the first time
        self._skip: dict[str, tuple[str, str, int]] = {}

    def line(self, raw: str) -> bool:
        """Take one line; returns whether it was understood, and needs no showing."""
        if "interceptor::access_control" not in raw:
            return self._connection(raw)
        # most lines say that something was allowed
        if "Using cached result" in raw:
            if " unauthorized " in raw and (found := _CACHED.search(_COLOUR.sub("", raw))):
                self._refused(self._names.get(found["zid"], "somebody"), found["what"], found["key"].strip())
            return True
        text = _COLOUR.sub("", raw)
        if found := _CACHING.search(text):
            self._skip[found["thread"]] = (found["flow"], found["key"], ACTIONS)
        elif found := _ACTION.search(text):
            self._action(found)
        return True

    def _action(self, found: re.Match[str]) -> None:
        name = _NAME.search(found["subject"])
        if name is not None and len(self._names) < 16 * MOST_NAMES:
            self._names[found["zid"]] = name[1]
        flow, key, left = self._skip.get(found["thread"], ("", "", 0))
        if left and (flow, key) == (found["flow"], found["key"]):
            self._skip[found["thread"]] = (flow, key, left - 1)
        elif found["un"] and found["flow"] == "ingress":
            self._refused(name[1] if name else "somebody", found["what"], found["key"])

    def _connection(self, raw: str) -> bool:
        found = _CONNECTION.search(_COLOUR.sub("", raw))
        if found is None:
            return False
        # the time of the check is another one each time
        self._refused("somebody", "connect", re.sub(r": verification time .*", "", found["why"]))
        return True

    def _refused(self, who: str, what: str, where: str) -> None:
        refused = (who, what, where)
        if refused not in self.counts:
            if who not in self._kinds and len(self._kinds) >= MOST_NAMES:
                who = "others"
            kinds = self._kinds[who] = self._kinds.get(who, 0) + 1
            refused = (who, what, where) if kinds <= MOST_OF_ONE else (who, *FURTHER)
        count = self.counts.setdefault(refused, Count())
        count.total += 1
        now = self._clock()
        if not count.said or now - count.said_s >= SAY_EVERY_S:
            self._say(refused, count, now)

    def _say(self, refused: Refused, count: Count, now: float) -> None:
        who, what, where = refused
        times = "" if count.total == 1 else f" ({count.total} times)"
        count.said, count.said_s = count.total, now
        if what == "connect":
            self._tell("connection_refused", f"a connection was refused: {where}{times}")
        else:
            self._tell("access_refused", f"{who} may not {VERBS.get(what, what)} {where}{times}")

    def rest(self) -> None:
        """Say what was counted since it was last said."""
        now = self._clock()
        for refused, count in self.counts.items():
            if count.total > count.said and now - count.said_s >= SAY_EVERY_S:
                self._say(refused, count, now)
