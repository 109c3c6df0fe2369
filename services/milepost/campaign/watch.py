"""What a campaign takes down of a run: live states, truth and warnings, as they are sent."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from milepost.estimation.time_units import S_PER_NS
from milepost.nodes.base import Output
from milepost.offline.run import OFFLINE_START_NS
from milepost_schemas import BaliseTelegram, Event, FusedState, Truth


class Seen(NamedTuple):
    """A live state, in scenario time.

    `excluded`: units and reasons, `unheard`: those of them that say nothing in time. `since_m`: distance since the last balise,
    None before the first; `location_accuracy_m`: of its place on the line.
    """

    position_m: float
    position_min_m: float
    position_max_m: float
    speed_mps: float
    speed_min_mps: float
    speed_max_mps: float
    status: str
    excluded: tuple[tuple[str, str], ...]
    reset_m: float | None
    since_m: float | None
    doubted: tuple[str, ...] = ()
    unheard: tuple[str, ...] = ()
    location_accuracy_m: float = 0.0


class Said(NamedTuple):
    """A warning or an error: when it was sent, in scenario time, by whom, and what."""

    at_s: float
    unit: str
    code: str
    text: str


def scenario_s(at_ns: int) -> float:
    """Scenario time, exact to the nanosecond."""
    return (at_ns - OFFLINE_START_NS) * S_PER_NS


@dataclass
class Watch:
    """Live states and the truth (position m, speed m/s) by scenario time, warnings, and when which reader sent telegrams.

    `accuracies_m`: how well the place of each balise is known.
    """

    accuracies_m: Mapping[str, float] = field(default_factory=dict)
    states: dict[float, Seen] = field(default_factory=dict)
    truth: dict[float, tuple[float, float]] = field(default_factory=dict)
    said: list[Said] = field(default_factory=list)
    telegrams: list[tuple[float, str]] = field(default_factory=list)

    def tap(self, output: Output, now_ns: int) -> None:
        """Take one message of the bus."""
        message = output.message
        if isinstance(message, FusedState):
            self.states.setdefault(scenario_s(message.measured_at_ns), seen(message, self.accuracies_m))
        elif isinstance(message, Truth):
            self.truth[scenario_s(message.measured_at_ns)] = message.position_m, message.speed_mps
        elif isinstance(message, BaliseTelegram):
            self.telegrams.append((scenario_s(now_ns), message.unit))
        elif isinstance(message, Event) and message.severity != "info":
            self.said.append(Said(scenario_s(now_ns), message.unit, message.code, message.text))


def seen(state: FusedState, accuracies_m: Mapping[str, float]) -> Seen:
    """What a campaign needs of a state."""
    reset = getattr(state, "reset", None)
    return Seen(
        state.position_m,
        state.position_min_m,
        state.position_max_m,
        state.speed_mps,
        state.speed_min_mps,
        state.speed_max_mps,
        state.status,
        tuple((each.unit, each.reason) for each in state.excluded),
        None if reset is None else abs(reset.size_m),
        None if state.last_balise is None else state.last_balise.distance_since_m,
        tuple(getattr(state, "doubted", ())),
        tuple(each.unit for each in state.excluded if each.says_nothing),
        0.0 if state.last_balise is None else accuracies_m.get(state.last_balise.balise_id, 0.0),
    )
