"""How a fuser hands over all that it knows."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from typing import Any

from milepost.nodes.base import Node
from milepost.runtime.bus import Question, ZenohBus
from milepost_schemas import SnapshotPart, encode, rpc_key

from .asking import SNAPSHOT

log = logging.getLogger("milepost")


class HandingOver:
    """Answers a replica's question in parts, between the steps of a process, which have to go on; one question at a time."""

    def __init__(self, bus: ZenohBus, node: Node, name: str) -> None:
        self._bus, self._node = bus, node
        self._key = rpc_key(bus.train, SNAPSHOT, name)
        self._query: Any = None
        # asked once before anything is known, a node has made what it packs with: three milliseconds
        self._parts: Iterator[SnapshotPart] = node.hand_over(0) if node.peers else iter(())

    @property
    def busy(self) -> bool:
        """Whether there is a part to be sent."""
        return self._query is not None

    def begin(self, question: Question, now_ns: int) -> None:
        """Take a question; a second one at the same time gets no answer."""
        if self.busy:
            question.query.drop()
        else:
            self._query, self._parts = question.query, self._node.hand_over(now_ns)

    def next(self) -> None:
        """Send the next part; the question ends after the last one."""
        try:
            part = next(self._parts, None)
        except ValueError as error:
            log.warning("what is known cannot be handed over: %s", error)
            part = None
        if part is None:
            self._query.drop()
            self._query = None
        else:
            self._query.reply(self._key, encode(part))
