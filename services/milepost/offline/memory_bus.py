"""The same nodes without Zenoh: messages are handed over at once, time goes from event to event."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from milepost.nodes.base import Node, Output
from milepost_schemas import Message

Tap = Callable[[Output, int], None]


class MemoryBus:
    """Runs nodes in one thread on a clock that jumps to whatever is next; `tap` sees every message and its time."""

    def __init__(self, nodes: Sequence[Node], tap: Tap | None = None, before_step: Callable[[int], None] | None = None) -> None:
        self._nodes = list(nodes)
        self._tap = tap
        self._before_step = before_step
        self._routes: dict[tuple[str, str], tuple[list[Node], list[Node]]] = {}
        # what wakes nobody: each node's newest message of a stream, until a message of another one comes
        self._newest: dict[Node, dict[str, Message]] = {}
        self._queue: deque[Output] = deque()
        self._due: dict[Node, int] = {}

    def run_until(self, until_ns: int) -> int | None:
        """Do all ticks before `until_ns`; returns when the next one would be, None if no node wants one."""
        due = self._due
        # somebody outside may have spoken to a node since the last time
        for node in self._nodes:
            self._ask(node)
        while due:
            node = min(due, key=due.__getitem__)
            due_ns = due[node]
            if due_ns >= until_ns:
                return due_ns
            if self._before_step is not None:
                self._before_step(due_ns)
            self._queue.extend(node.tick(due_ns))
            self._ask(node)
            self._deliver(due_ns)
        return None

    def _ask(self, node: Node) -> None:
        """Note when a node wants its next tick; only its own steps and ticks change that."""
        at = node.next_tick_ns()
        if at is None:
            self._due.pop(node, None)
        else:
            self._due[node] = at

    def inject(self, stream: str, unit: str, message: Message, now_ns: int) -> None:
        """A message from outside, received at `now_ns`."""
        if self._before_step is not None:
            self._before_step(now_ns)
        self._queue.append(Output(stream, unit, message))
        self._deliver(now_ns)

    def _deliver(self, now_ns: int) -> None:
        queue, tap, routes = self._queue, self._tap, self._routes
        while queue:
            output = queue.popleft()
            if tap is not None:
                tap(output, now_ns)
            where = (output.stream, output.unit)
            route = routes.get(where)
            if route is None:
                route = routes[where] = (self._listeners(*where, newest=False), self._listeners(*where, newest=True))
            for node in route[1]:
                self._newest.setdefault(node, {})[output.stream] = output.message
            for node in route[0]:
                for message in self._newest.pop(node, {}).values():
                    queue.extend(node.step(message, now_ns))
                queue.extend(node.step(output.message, now_ns))
                self._ask(node)

    def _listeners(self, stream: str, unit: str, newest: bool) -> list[Node]:
        return [node for node in self._nodes if _wants(node, stream, unit, newest)]


def _wants(node: Node, stream: str, unit: str, newest: bool) -> bool:
    return any(s.stream == stream and s.unit in ("*", unit) and s.newest_only == newest for s in node.subscriptions)
