"""Which instances of each process live, by their liveliness tokens, and which process has more than one."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any, NamedTuple

from milepost_schemas import alive_key

# the token of a process that was stopped or cut off lives on for its lease of 1 s beside its successor's
OVERLAP_S = 1.5
ASK_EVERY_S = 0.1


class Token(NamedTuple):
    """What the key of a liveliness token says."""

    train: str
    unit: str
    instance: str


class Change(NamedTuple):
    """A process has more than one instance (`instances` names them), or (empty) no longer has."""

    train: str
    unit: str
    instances: tuple[str, ...]

    @property
    def text(self) -> str:
        """The change as a sentence."""
        if not self.instances:
            return f"{self.unit} has one instance again"
        return f"{self.unit} has {len(self.instances)} instances ({', '.join(self.instances)}): end all but one"


def token_of(key: object) -> Token:
    """The train, process and instance in a token's key."""
    train, _, unit, instance = str(key).rsplit("/", 4)[-4:]
    return Token(train, unit, instance)


class Instances:
    """The tokens seen and not gone. Times are of any clock in seconds that goes with real time."""

    def __init__(self) -> None:
        self._since: dict[tuple[str, str], dict[str, float]] = {}
        self._second: dict[tuple[str, str], tuple[str, ...]] = {}

    def changed(self, token: Token, alive: bool, now_s: float) -> None:
        """A token appeared or went."""
        since = self._since.setdefault((token.train, token.unit), {})
        if alive:
            since.setdefault(token.instance, now_s)
        else:
            since.pop(token.instance, None)

    def live(self, train: str, unit: str) -> bool:
        """Whether a process has an instance."""
        return bool(self._since.get((train, unit)))

    def second(self, now_s: float) -> dict[tuple[str, str], tuple[str, ...]]:
        """The instances of each process that has had more than one for longer than a dying one's token stays."""
        out = {}
        for process, since in self._since.items():
            lasting = sorted(instance for instance, at in since.items() if now_s - at >= OVERLAP_S)
            if len(lasting) > 1:
                out[process] = tuple(lasting)
        return out

    def changes(self, now_s: float) -> Iterator[Change]:
        """What is different from the last time this was asked."""
        before, self._second = self._second, self.second(now_s)
        for process in sorted(set(before) | set(self._second)):
            instances = self._second.get(process, ())
            if instances != before.get(process, ()):
                yield Change(*process, instances)


def live_tokens(session: Any, train: str = "*", unit: str = "*") -> set[Token]:
    """The tokens that a router knows now."""
    replies = session.liveliness().get(alive_key(train, unit), timeout=1.0)
    return {token_of(reply.ok.key_expr) for reply in replies if reply.ok is not None}


def lasting_others(session: Any, train: str, unit: str) -> set[Token]:
    """The instances of a process that are there now and stay, asked before it declares its own token.

    Where there is none, as there should be, this is one query.
    """
    others = live_tokens(session, train, unit)
    deadline = time.monotonic() + OVERLAP_S
    while others and time.monotonic() < deadline:
        time.sleep(ASK_EVERY_S)
        others &= live_tokens(session, train, unit)
    return others


def second_instances(session: Any) -> list[Change]:
    """All processes of all trains that have more than one instance, now and when a dying one's token would be gone."""

    def crowded(tokens: set[Token]) -> dict[tuple[str, str], tuple[str, ...]]:
        found: dict[tuple[str, str], tuple[str, ...]] = {}
        for token in sorted(tokens):
            found[token[:2]] = (*found.get(token[:2], ()), token.instance)
        return {process: instances for process, instances in found.items() if len(instances) > 1}

    tokens = live_tokens(session)
    if not crowded(tokens):
        return []
    time.sleep(OVERLAP_S)
    return [Change(*process, instances) for process, instances in crowded(tokens & live_tokens(session)).items()]
