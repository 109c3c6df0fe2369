"""A subscriber with the quality of service of its stream."""

from __future__ import annotations

from typing import Any

import zenoh.ext

from milepost_schemas import Stream

# the binding's stubs ask for both of two options that exclude each other
RECOVERY: Any = zenoh.ext.RecoveryConfig


def subscriber(session: Any, stream: Stream, key: str, receive: Any, paced_too: bool = False) -> Any:
    """Call `receive` with every sample. Where its publishers remember, what an interruption lost is asked for again.

    `receive`: a function, or one of Zenoh's handlers. `paced_too`: also of streams that go on by themselves, where who listens
    only wants the newest.
    """
    if stream.cached and (paced_too or stream.paced_by == "event"):
        recovery: Any = RECOVERY(heartbeat=True)
        return zenoh.ext.declare_advanced_subscriber(session, key, receive, recovery=recovery)
    return session.declare_subscriber(key, receive)
