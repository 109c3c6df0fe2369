"""The memory bus: messages are delivered at once, and time goes from event to event."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence

from milepost.nodes.base import Node, Output
from milepost_schemas import Message

Tap = Callable[[Output, int], None]


class MemoryBus:
    """Runs nodes in one thread on a clock that jumps to the next tick; `tap` is called with every message and its time."""

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
        """Do all ticks before `until_ns`; returns the time of the next one, None if there is none."""
        due = self._due
        # a node's next tick may have changed from outside since the last call
        for node in self._nodes:
            self._schedule(node)
        while due:
            node = min(due, key=due.__getitem__)
            due_ns = due[node]
            if due_ns >= until_ns:
                return due_ns
            if self._before_step is not None:
                self._before_step(due_ns)
            self._queue.extend(node.tick(due_ns))
            self._schedule(node)
            self._deliver(due_ns)
        return None

    def _schedule(self, node: Node) -> None:
        """Note the time of a node's next tick; only its own steps and ticks change it."""
        at = node.next_tick_ns()
        if at is None:
            self._due.pop(node, None)
        else:
            self._due[node] = at

    def inject(self, stream: str, unit: str, message: Message, now_ns: int) -> None:
        """Deliver a message from outside, received at `now_ns`."""
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
                self._schedule(node)

    def _listeners(self, stream: str, unit: str, newest: bool) -> list[Node]:
        return [node for node in self._nodes if _subscribes(node, stream, unit, newest)]


def _subscribes(node: Node, stream: str, unit: str, newest: bool) -> bool:
    return any(s.stream == stream and s.unit in ("*", unit) and s.newest_only == newest for s in node.subscriptions)
