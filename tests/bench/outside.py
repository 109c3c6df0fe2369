"""What a plain subscriber sees of a fleet; it shares no code with the package."""

from __future__ import annotations

import threading
import time
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

import msgpack
import numpy as np


@dataclass
class Outside:
    """A plain subscriber to all states: by train, when the first one came; since `begin`, epochs, ages, what was amiss."""

    first_s: dict[str, float] = field(default_factory=dict)
    epochs: dict[str, list[int]] = field(default_factory=dict)
    ages_ms: list[float] = field(default_factory=list)
    awaiting: int = 0
    statuses: Counter[str] = field(default_factory=Counter)
    # when which position came, for the page: by train, milliseconds of the clock and what a reader would see of it
    places: dict[str, list[tuple[float, str]]] = field(default_factory=dict)
    listening: bool = False
    lock: threading.Lock = field(default_factory=threading.Lock)

    def receive(self, sample: Any) -> None:
        now_ns, state = time.time_ns(), msgpack.unpackb(sample.payload.to_bytes())
        with self.lock:
            self.first_s.setdefault(state["train"], time.monotonic())
            if not self.listening:
                return
            self.epochs.setdefault(state["train"], []).append(state["epoch"])
            self.ages_ms.append((now_ns - state["measured_at_ns"]) / 1e6)
            self.awaiting += bool(state["awaiting"])
            self.statuses[state["status"]] += 1
            self.places.setdefault(state["train"], []).append((now_ns / 1e6, f"{state['position_m']:.1f}"))

    def lags_ms(self, shown: list[tuple[str, str, float]]) -> list[float]:
        """How much later than here each position stood on the page; its train's newest state with that position is meant."""
        with self.lock:
            places = {train: list(reversed(places)) for train, places in self.places.items()}
        came = (
            (at, next((t for t, said in places.get(train, ()) if said == text and t <= at), None)) for train, text, at in shown
        )
        return [at - t for at, t in came if t is not None]

    def figures(self, trains: int, hz: float, for_s: float) -> dict[str, Any]:
        with self.lock:
            seen = sum(map(len, self.epochs.values()))
            missing = sum(max(e) - min(e) + 1 - len(set(e)) for e in self.epochs.values())
            repeated = sum(len(e) - len(set(e)) for e in self.epochs.values())
            ages = np.percentile(self.ages_ms, [50, 99, 100]) if self.ages_ms else [float("nan")] * 3
        return {
            "trains_seen": len(self.epochs),
            "states_per_s": seen / for_s,
            "expected_per_s": trains * hz,
            "epochs_missing": missing,
            "epochs_repeated": repeated,
            "states_awaiting": self.awaiting,
            "statuses": dict(self.statuses),
            **{f"age_{name}_ms": float(age) for name, age in zip(("p50", "p99", "max"), ages, strict=True)},
        }
