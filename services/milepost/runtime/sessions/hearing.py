"""Cuts connections over which nothing comes back, so that Zenoh makes them anew.

Zenoh 1.10 gives up opening a connection after `open_timeout` even in the moment in which the connection is there, as when a
router that stood still goes on. What is left of it sends and never receives, is kept alive, and is not replaced: the router
refuses a second connection of the same session (`MAX_LINKS`).
"""

from __future__ import annotations

import contextlib
import logging
import os
import re
import socket
import stat
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, NamedTuple

import zenoh

from milepost_schemas import HEARING_KEY, router_key

log = logging.getLogger("milepost")
EVERY_S, ANSWER_S = 1.0, 1.0
# a neighbour that stands still is lost by its lease before its second silence; the third is for a busy machine
MOST_SILENCES, MOST_CUTS = 3, 3
OPEN_FILES = Path("/proc/self/fd" if Path("/proc/self/fd").is_dir() else "/dev/fd")
INTERNET = (socket.AF_INET, socket.AF_INET6)
PORT = re.compile(r":(\d+)(?=$|[?#])")


class Look(NamedTuple):
    """A session's neighbours by their Zenoh ids, and those of them from which nothing came back."""

    neighbours: frozenset[str]
    silent: frozenset[str]


class Hearing:
    """Which neighbours were silent so often in a row that their connections are to be cut.

    Looks are counted, not seconds: a process that was stopped has not looked. After each cut twice as many silences are needed,
    until the neighbour is heard. One that was never heard is left alone after `MOST_CUTS`: it does not answer such questions.
    """

    def __init__(self) -> None:
        self._silences: dict[str, int] = {}
        self._cuts: dict[str, int] = {}
        self._heard: set[str] = set()

    def deaf_to(self, look: Look) -> list[str]:
        """The neighbours whose connections are to be cut after one more look."""
        heard = look.neighbours - look.silent
        self._heard |= heard
        self._cuts = {each: times for each, times in self._cuts.items() if each not in heard}
        self._silences = {each: self._silences.get(each, 0) + 1 for each in look.neighbours & look.silent}
        found = sorted(each for each in self._silences if self._is_deaf(each))
        for each in found:
            del self._silences[each]
            self._cuts[each] = self._cuts.get(each, 0) + 1
        return found

    def _is_deaf(self, neighbour: str) -> bool:
        cuts = self._cuts.get(neighbour, 0)
        return self._silences[neighbour] >= MOST_SILENCES * 2**cuts and (neighbour in self._heard or cuts < MOST_CUTS)


def ask_router(session: Any) -> Look:
    """A client's look: it asks its router for tokens that nobody has, and hears at least that this is all."""
    unanswered = any(reply.ok is None for reply in session.liveliness().get(HEARING_KEY, timeout=ANSWER_S))
    routers = _linked_routers(session)
    return Look(routers, routers if unanswered else frozenset())


def look_for_routers(session: Any) -> Look:
    """A router's look: each router that it is linked with shows a token."""
    routers = _linked_routers(session)
    seen = {str(r.ok.key_expr).rpartition("/")[2] for r in session.liveliness().get(router_key("*"), timeout=ANSWER_S) if r.ok}
    return Look(routers, routers - seen)


LOOKS: dict[str, Callable[[Any], Look]] = {"client": ask_router, "router": look_for_routers}


@contextlib.contextmanager
def hearing_well(session: Any, config: Mapping[str, Any]) -> Iterator[None]:
    """As long as a session is open, look once a second whether its connections bring anything, and cut those that do not.

    Whoever made a connection looks after it.
    """
    mode, connects = config.get("mode"), bool(config.get("connect", {}).get("endpoints"))
    with contextlib.ExitStack() as stack:
        if mode == "router":
            stack.callback(session.liveliness().declare_token(router_key(str(session.info.zid()))).undeclare)
        if connects and mode in LOOKS:
            stack.enter_context(_watched(session, LOOKS[mode]))
        yield


@contextlib.contextmanager
def _watched(session: Any, look: Callable[[Any], Look]) -> Iterator[None]:
    over = threading.Event()

    def watch() -> None:
        hearing = Hearing()
        while not over.wait(EVERY_S):
            # a connection that ends in the middle of a question is an error of the question
            with contextlib.suppress(zenoh.ZError, OSError):
                for neighbour in hearing.deaf_to(look(session)):
                    log.warning("nothing comes back from router %s: the connection is made anew", neighbour)
                    cut(session, neighbour)

    watching = threading.Thread(target=watch, name="hearing", daemon=True)
    watching.start()
    try:
        yield
    finally:
        over.set()
        watching.join()


def cut(session: Any, neighbour: str) -> int:
    """End a session's connections with a neighbour as a network would; how many there were. Zenoh offers no way to."""
    ends = {(_port(link.src), _port(link.dst)) for link in session.info.links() if str(link.zid) == neighbour}
    return sum(_shut_down(number, ends) for number in _open_files())


def _open_files() -> Iterable[int]:
    return [int(name) for name in os.listdir(OPEN_FILES) if name.isdigit()]


def _shut_down(number: int, ends: set[tuple[int | None, int | None]]) -> bool:
    """Whether an open file is a connection between two of these ports; then it is ended."""
    try:
        if not stat.S_ISSOCK(os.fstat(number).st_mode):
            return False
        with socket.socket(fileno=os.dup(number)) as copy:
            if copy.family not in INTERNET or (copy.getsockname()[1], copy.getpeername()[1]) not in ends:
                return False
            copy.shutdown(socket.SHUT_RDWR)
            return True
    except OSError:  # closed meanwhile, or not connected
        return False


def _port(endpoint: object) -> int | None:
    found = PORT.search(str(endpoint))
    return int(found[1]) if found else None


def _linked_routers(session: Any) -> frozenset[str]:
    return frozenset(str(each) for each in session.info.routers_zid())
