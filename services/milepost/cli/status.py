"""`milepost status`: one look."""

from __future__ import annotations

import json
import sys
import threading
import time

from milepost.runtime.bus import NoRouterError
from milepost.runtime.listening import listening
from milepost_schemas import FusedState, Message

SETTLE_S = 0.3


def run_status(connect: list[str], as_json: bool, timeout_s: float) -> int:
    """Print the newest state of every train that speaks; 0 only if there is one and all are normal."""
    states: dict[str, FusedState] = {}
    first = threading.Event()

    def receive(_: str, message: Message, __: int) -> None:
        if isinstance(message, FusedState):
            states[message.train] = message
            first.set()

    try:
        with listening(connect, ["state"], "*", receive):
            if first.wait(timeout_s):
                # other trains on the same router speak within a few epochs
                time.sleep(SETTLE_S)
    except NoRouterError as error:
        print(f"milepost: {error}", file=sys.stderr)
        return 1
    if not states:
        print(f"milepost: no state within {timeout_s:g} s", file=sys.stderr)
        return 1
    if as_json:
        print(json.dumps([state.model_dump(mode="json") for state in states.values()]))
    else:
        for state in states.values():
            print(_line(state))
    return 0 if all(state.status == "normal" for state in states.values()) else 1


def _line(state: FusedState) -> str:
    excluded = ", ".join(f"{e.unit} ({e.reason})" for e in state.excluded)
    return (
        f"{state.train}: {state.status}: {state.position_m:.2f} m on {state.line} "
        f"[{state.position_min_m:.2f}, {state.position_max_m:.2f}], {state.speed_mps * 3.6:.2f} km/h"
        + (f"; without {excluded}" if excluded else "")
    )
