"""What a process that was restarted asks of the others, and what it believes of their answers."""

from __future__ import annotations

import logging
from collections.abc import Collection

from milepost.estimation.time_units import NS_PER_S
from milepost.nodes.base import Node
from milepost.nodes.catching_up.agreement import most_agreed
from milepost.runtime.bus import ZenohBus
from milepost.runtime.clock import Clock
from milepost_schemas import Feedback, Refused, SnapshotPart, rpc_key

log = logging.getLogger("milepost")
LATEST, SNAPSHOT = "latest_feedback", "snapshot"
# how long a starting process waits for those that may remember the fused state, and a fuser for the snapshot of another one
ASK_S, ASK_SNAPSHOT_S = 0.5, 1.0


def serve(bus: ZenohBus, node: Node, name: str) -> None:
    """Receive the questions that a node answers."""
    if node.remembers:
        bus.serve(LATEST, name)
    if node.peers:
        bus.serve(SNAPSHOT, name)


def catch_up(bus: ZenohBus, node: Node, clock: Clock, known: Collection[str]) -> bool:
    """Begin with what the others know; False if nobody remembers a fused state.

    A fuser takes over all that a replica knows; where it cannot, and in a filter, it is the fused state that most remember.
    """
    latest = most_agreed(bus.ask(rpc_key(bus.train, LATEST), Feedback, ASK_S), known)
    if latest is None:
        # the others are just beginning too, and would not answer before they have asked
        return False
    if _takes_over(bus, node, clock, latest):
        return True
    now_ns = clock.now_ns()
    if node.catch_up(latest, now_ns):
        log.info("continuing from the state of %.2f s ago", (now_ns - latest.measured_at_ns) / NS_PER_S)
    # an answer that could not be taken still says that the fused state lives: what is in it must not be told again
    return True


def _takes_over(bus: ZenohBus, node: Node, clock: Clock, latest: Feedback) -> bool:
    """Whether a replica's snapshot was taken over: the newest that is not refused."""
    if not node.peers:
        return False
    answers: dict[tuple[int, str, str], list[SnapshotPart]] = {}
    for name, part in bus.ask(rpc_key(bus.train, SNAPSHOT), SnapshotPart, ASK_SNAPSHOT_S, droppable=True):
        if name in node.peers:
            answers.setdefault((part.taken_at_ns, name, part.fingerprint), []).append(part)
    for (taken_ns, name, _), parts in sorted(answers.items(), reverse=True):
        now_ns = clock.now_ns()
        try:
            node.take_over(parts, latest, now_ns)
        except Refused as refused:
            text = f"the snapshot of {name} is not used: {refused.detail}"
            log.warning("%s", text)
            bus.publish(*node.event("warning", "snapshot_refused", f"{node.unit}: {text}", now_ns))
        else:
            log.info("continuing with all that %s knew %.2f s ago", name, (now_ns - taken_ns) / NS_PER_S)
            return True
    return False
