"""`milepost status`: one look."""

from __future__ import annotations

import json
import sys
import threading
import time
from typing import Any

from milepost.runtime.bus import NoRouterError
from milepost.runtime.instances import Change, second_instances
from milepost.runtime.listening import listening
from milepost.runtime.zenoh_config import Connection
from milepost_schemas import FusedState, Message

SETTLE_S = 0.3


def run_status(connect: Connection, as_json: bool, timeout_s: float) -> int:
    """Print the newest state of every train that speaks; 0 only if there is one, all are normal and no process runs twice."""
    states: dict[str, FusedState] = {}
    first = threading.Event()

    def receive(_: str, message: Message, __: int) -> None:
        if isinstance(message, FusedState):
            states[message.train] = message
            first.set()

    try:
        with listening(connect, ["state"], "*", receive) as session:
            if first.wait(timeout_s):
                # other trains on the same router speak within a few epochs
                time.sleep(SETTLE_S)
            second = second_instances(session)
    except NoRouterError as error:
        print(f"milepost: {error}", file=sys.stderr)
        return 1
    for change in second:
        print(f"milepost: {change.train}: {change.text}", file=sys.stderr)
    if not states:
        print(f"milepost: no state within {timeout_s:g} s", file=sys.stderr)
        return 1
    if as_json:
        print(json.dumps([_fields(state, second) for _, state in sorted(states.items())]))
    else:
        for _, state in sorted(states.items()):
            print(_line(state))
    return 0 if all(state.status == "normal" for state in states.values()) and not second else 1


def _fields(state: FusedState, second: list[Change]) -> dict[str, Any]:
    crowded = {change.unit: list(change.instances) for change in second if change.train == state.train}
    return {**state.model_dump(mode="json"), "second_instances": crowded}


def _line(state: FusedState) -> str:
    wrong, unheard = (
        ", ".join(f"{e.unit} ({e.reason})" for e in state.excluded if e.says_nothing == nothing) for nothing in (False, True)
    )
    return (
        f"{state.train}: {state.status}: {state.position_m:.2f} m on {state.line} "
        f"[{state.position_min_m:.2f}, {state.position_max_m:.2f}], {state.speed_mps * 3.6:.2f} km/h"
        + (f"; excluded: {wrong}" if wrong else "")
        + (f"; not heard: {unheard}" if unheard else "")
        + (f"; one of {', '.join(state.doubted)} is wrong" if state.doubted else "")
        + (f"; sent before {', '.join(state.awaiting)} had come" if state.awaiting else "")
    )
