"""The outside observer behind `milepost up --report`: what a dispatch tool would have seen."""

from __future__ import annotations

import json
import signal
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from milepost.runtime.listening import listening
from milepost.runtime.zenoh_config import Connection, client
from milepost_schemas import BalisePassed, FusedState, Message, Truth

from .stalls import Stall, read_stalls, stalled_ns

GAP_MS = 60.0


class Seen(NamedTuple):
    """What a report needs of a state: an hour of whole ones would be a gigabyte."""

    epoch: int
    measured_at_ns: int
    status: str
    position_m: float
    position_min_m: float
    position_max_m: float
    speed_mps: float
    speed_min_mps: float
    speed_max_mps: float
    last_balise: BalisePassed | None


def run_observe(connect: Connection, trains: Sequence[str], report: Path, stalls: Path) -> None:
    """Listen until stopped, then write the report: of one train its figures, of several those of each by its name."""
    states: dict[str, list[tuple[Seen, int]]] = {train: [] for train in trains}
    truths: dict[str, dict[int, Truth]] = {train: {} for train in trains}

    def receive(_: str, message: Message, now_ns: int) -> None:
        if message.train not in states:
            return
        if isinstance(message, FusedState):
            states[message.train].append((Seen(*(getattr(message, name) for name in Seen._fields)), now_ns))
        elif isinstance(message, Truth):
            truths[message.train][message.measured_at_ns] = message

    done = threading.Event()
    # it is started together with the router, and waits for it
    with listening(connect, ["state", "truth"], trains[0] if len(trains) == 1 else "*", receive, config=client):
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, lambda *_: done.set())
        done.wait()
    stalled = read_stalls(stalls)
    figures = {train: summarise(states[train], truths[train], stalled) for train in trains}
    found = figures[trains[0]] if len(trains) == 1 else {"trains": figures}
    report.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")


def summarise(
    states: Sequence[tuple[Seen | FusedState, int]], truths: dict[int, Truth], stalls: Sequence[Stall]
) -> dict[str, Any]:
    """Rate and gaps as received; errors against the truth after the first balise; whether the interval held it."""
    if len(states) < 2:
        return {"states": len(states), "error": "fewer than two states were received"}
    received = np.array([at for _, at in states])
    gaps_ms = np.diff(received) / 1e6
    epochs = [state.epoch for state, _ in states]
    span_s = (received[-1] - received[0]) / 1e9
    out: dict[str, Any] = {
        "states": len(states),
        "first_at_ns": states[0][1],
        "duration_s": span_s,
        "rate_hz": (len(states) - 1) / span_s,
        "epochs_missing": epochs[-1] - epochs[0] + 1 - len(set(epochs)),
        "gap_ms": {"median": float(np.median(gaps_ms)), "p99": float(np.percentile(gaps_ms, 99)), "max": float(gaps_ms.max())},
        "age_ms": _ages(states),
        "statuses": {s: sum(state.status == s for state, _ in states) for s in sorted({state.status for state, _ in states})},
    }
    long = [_explained(received[i], received[i + 1], stalls) for i in np.flatnonzero(gaps_ms > GAP_MS)]
    out["gaps_over_60ms"] = long
    out["gaps_over_60ms_unexplained"] = sum(gap["stall_ms"] < gap["gap_ms"] - GAP_MS for gap in long)
    out["stall_max_ms"] = max(((end - begin) / 1e6 for begin, end in stalls), default=0.0)
    out["truth"] = _against_truth([state for state, _ in states], truths)
    return out


def _explained(before_ns: int, after_ns: int, stalls: Sequence[Stall]) -> dict[str, float]:
    stall_ms = float(stalled_ns(stalls, before_ns, after_ns)) / 1e6
    return {"at_ns": int(before_ns), "gap_ms": float(after_ns - before_ns) / 1e6, "stall_ms": stall_ms}


def _ages(states: Sequence[tuple[Seen | FusedState, int]]) -> dict[str, float] | None:
    """From an epoch to the receipt of its state; None where scenario time runs at another speed than the receiver's clock."""
    ages = [(at - state.measured_at_ns) / 1e6 for state, at in states]
    return _spread(ages) if min(ages) >= 0.0 else None


def _spread(values: list[float]) -> dict[str, float]:
    return {"p50": float(np.median(values)), "p99": float(np.percentile(values, 99)), "max": float(max(values))}


def _against_truth(states: Sequence[Seen | FusedState], truths: dict[int, Truth]) -> dict[str, Any] | None:
    pairs = [(state, truths[state.measured_at_ns]) for state in states if state.measured_at_ns in truths]
    if not pairs:
        return None
    outside = sum(not s.position_min_m <= t.position_m <= s.position_max_m for s, t in pairs)
    outside_speed = sum(not s.speed_min_mps <= t.speed_mps <= s.speed_max_mps for s, t in pairs)
    after = [(s, t) for s, t in pairs if s.last_balise is not None] or pairs
    position = np.array([s.position_m - t.position_m for s, t in after])
    speed = np.array([s.speed_mps - t.speed_mps for s, t in after])
    return {
        "compared": len(pairs),
        "outside_interval": outside,
        "outside_speed_interval": outside_speed,
        "position_rms_m": float(np.sqrt(np.mean(position**2))),
        "position_max_m": float(np.abs(position).max()),
        "speed_rms_mps": float(np.sqrt(np.mean(speed**2))),
        "speed_max_mps": float(np.abs(speed).max()),
    }
