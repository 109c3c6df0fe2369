"""`milepost status`: one look."""

from __future__ import annotations

import json
import sys
import threading
import time
from typing import Any

from milepost.config.roles import ROLES
from milepost.runtime.bus import NoRouterError
from milepost.runtime.instances import Change, live_tokens, second_instances
from milepost.runtime.listening import listening
from milepost.runtime.zenoh_config import Connection
from milepost_schemas import FusedState, Message

# a train that has processes and says nothing
SILENT = "silent"


def run_status(connect: Connection, as_json: bool, timeout_s: float) -> int:
    """Print the newest state of every train; 0 only if there is one, all speak and are normal, and no process runs twice.

    A train that has a process is waited for: one whose fuser hangs would otherwise be passed over.
    """
    states: dict[str, FusedState] = {}
    news = threading.Event()

    def receive(_: str, message: Message, __: int) -> None:
        if isinstance(message, FusedState):
            states[message.train] = message
            news.set()

    try:
        with listening(connect, ["state"], "*", receive) as session:
            until = time.monotonic() + timeout_s
            running = {token.train for token in live_tokens(session) if token.unit.partition("-")[0] in ROLES}
            while not (states and running <= states.keys()) and (left := until - time.monotonic()) > 0.0:
                news.wait(left)
                news.clear()
            second = second_instances(session)
    except NoRouterError as error:
        print(f"milepost: {error}", file=sys.stderr)
        return 1
    for change in second:
        print(f"milepost: {change.train}: {change.text}", file=sys.stderr)
    silent = sorted(running - states.keys())
    if not states and not silent:
        print(f"milepost: no state within {timeout_s:g} s", file=sys.stderr)
        return 1
    if as_json:
        rows = [_fields(state, second) for state in states.values()] + [{"train": name, "status": SILENT} for name in silent]
        print(json.dumps(sorted(rows, key=lambda row: str(row["train"]))))
    else:
        lines = {state.train: _line(state) for state in states.values()}
        lines |= {name: f"{name}: {SILENT}: no state within {timeout_s:g} s" for name in silent}
        print("\n".join(line for _, line in sorted(lines.items())))
    return 0 if not silent and all(state.status == "normal" for state in states.values()) and not second else 1


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
