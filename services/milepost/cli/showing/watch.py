"""The live table, for `milepost watch` and `milepost up`."""

from __future__ import annotations

import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import NamedTuple

from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from milepost.runtime.instances import Change, Instances, Token
from milepost.runtime.listening import listening
from milepost.runtime.zenoh_config import Connection
from milepost_schemas import Event, FusedState, Health, Message, Truth

from .arrivals import Arrivals
from .until_interrupted import until_interrupted

STYLES = {"normal": "green", "initialising": "cyan", "degraded": "yellow", "coasting": "yellow", "lost": "red"}
STREAMS = ["state", "truth", "health", "event"]
REFRESH_S = 0.25
STALE_S = 1.0
# a stream with less than this share of its expected rate is slow
SLOW = 0.8
KEPT_EVENTS = 4


class Error(NamedTuple):
    """The true error of a state, and whether its interval held the true position."""

    position_m: float
    speed_mps: float
    inside: bool

    def __str__(self) -> str:
        """For the table of one train."""
        where = "inside" if self.inside else "OUTSIDE"
        return f"{self.position_m:+12.3f} m, {self.speed_mps:+.4f} m/s, {where} the interval"

    def short(self) -> str:
        """For a row among others."""
        return f"{self.position_m:+.2f} m" + ("" if self.inside else " OUTSIDE")


class Screen:
    """What was last heard, as a table."""

    def __init__(self) -> None:
        self.states: dict[str, tuple[FusedState, int]] = {}
        self.errors: dict[str, Error] = {}
        self.healths: dict[tuple[str, str], Health] = {}
        self.events: list[str] = []
        self.arrivals: Arrivals | None = None
        self._instances = Instances()
        self._recent: dict[str, deque[FusedState]] = {}

    def receive(self, stream: str, message: Message, now_ns: int) -> None:  # noqa: ARG002
        """Take one message."""
        if isinstance(message, FusedState):
            self.states[message.train] = (message, now_ns)
            self._recent.setdefault(message.train, deque(maxlen=64)).append(message)
        elif isinstance(message, Truth):
            # the truth of an epoch is told a little after its state
            # states come in another thread meanwhile
            for state in tuple(self._recent.get(message.train, ())):
                if state.measured_at_ns == message.measured_at_ns:
                    self.errors[state.train] = _error(state, message)
        elif isinstance(message, Health):
            self.healths[(message.train, message.unit)] = message
        elif isinstance(message, Event):
            self.say(f"{message.train} {message.unit}: {message.text}")

    def alive(self, token: Token, there: bool) -> None:
        """A process's token appeared or went."""
        self._instances.changed(token, there, time.monotonic())

    def say(self, text: str) -> None:
        """Show a sentence."""
        self.events = [*self.events, f"{time.strftime('%H:%M:%S')} {text}"][-KEPT_EVENTS:]

    def render(self) -> Group:
        """The picture."""
        events = [Text(event, style="dim") for event in self.events]
        if not self.states:
            return Group(Text(self._waiting()), *events)
        second = [Text(sentence, style="red") for sentence in self.second_instances()]
        states = [state for _, state in sorted(self.states.items())]
        shown = self._train(*states[0]) if len(states) == 1 else self._overview(states)
        return Group(shown, *second, *events)

    def lines(self) -> list[str]:
        """The same in few words, for where there is no terminal."""
        return [*(_line(*state) for _, state in sorted(self.states.items())), *self.second_instances()]

    def _waiting(self) -> str:
        missing = self.arrivals.missing if self.arrivals else []
        return f"waiting for {', '.join(missing)}" if missing else "waiting for a state"

    def second_instances(self) -> list[str]:
        """A sentence for every process that runs more than once."""
        second = self._instances.second(time.monotonic())
        return [f"{train}: {Change(train, unit, instances).text}" for (train, unit), instances in second.items()]

    def _overview(self, states: Sequence[tuple[FusedState, int]]) -> Table:
        """Several trains, one in a row."""
        table = Table(box=None, padding=(0, 1))
        for column in ("train", "line", "status", "position m", "interval m", "km/h", "in use", "true error", "not in use"):
            numbers = column in ("position m", "km/h", "in use", "true error")
            table.add_column(column, justify="right" if numbers else "left", no_wrap=column != "not in use")
        for state, received_ns in states:
            table.add_row(
                state.train,
                state.line,
                _status(state, received_ns),
                f"{state.position_m:.2f}",
                f"[{state.position_min_m:.2f}, {state.position_max_m:.2f}]",
                f"{state.speed_mps * 3.6:.2f}",
                f"{len(state.sensors)}",
                self.errors[state.train].short() if state.train in self.errors else "",
                ", ".join(entry.unit for entry in state.excluded),
            )
        return table

    def _train(self, state: FusedState, received_ns: int) -> Group:
        table = Table(title=f"{state.train} on {state.line}", title_justify="left", show_header=False, box=None, padding=(0, 2))
        table.add_row("status", _status(state, received_ns))
        bounds = f"[{state.position_min_m:.2f}, {state.position_max_m:.2f}]"
        table.add_row("position", f"{state.position_m:12.3f} m    {bounds} ± {state.position_accuracy_m:.2f} m without faults")
        table.add_row(
            "speed", f"{state.speed_mps * 3.6:12.3f} km/h [{state.speed_min_mps * 3.6:.2f}, {state.speed_max_mps * 3.6:.2f}]"
        )
        if state.latitude_deg is not None and state.longitude_deg is not None:
            table.add_row("place", f"{state.latitude_deg:12.6f}, {state.longitude_deg:.6f}")
        if state.last_balise:
            table.add_row("balise", f"{state.last_balise.balise_id:>12} {state.last_balise.distance_since_m:.1f} m ago")
        if state.train in self.errors:
            table.add_row("true error", str(self.errors[state.train]))
        return Group(table, self._sensors(state))

    def _sensors(self, state: FusedState) -> Table:
        table = Table(box=None, padding=(0, 2))
        for column in ("sensor", "rate", "age", "share", "refused", "late", ""):
            table.add_column(column, justify="left" if column in ("sensor", "") else "right")
        wrong = state.said_wrong
        shown: list[tuple[str, str, str, str]] = [
            (s.unit, f"{s.age_s * 1e3:.0f} ms", f"{s.share:.2f}", "") for s in state.sensors
        ]
        shown += [(e.unit, "", "", e.reason) for e in state.excluded]
        for unit, age, share, reason in shown:
            health = self.healths.get((state.train, f"filter-{unit}")) or self.healths.get((state.train, f"sensor-{unit}"))
            rate = _rate(health) if health else Text("")
            refused = str(sum(health.refused.values())) if health else ""
            late = str(health.rewinds) if health else ""
            remark = reason or ("doubted" if unit in state.doubted else "awaited" if unit in state.awaiting else "")
            table.add_row(unit, rate, age, share, refused, late, Text(remark, style="red" if unit in wrong else "yellow"))
        return table


def _line(state: FusedState, received_ns: int) -> str:
    if stale := _stale(received_ns):
        return f"{state.train} {stale}, last at {state.position_m:.2f} m"
    return f"{state.train} {state.status} {state.position_m:.2f} m {state.speed_mps * 3.6:.2f} km/h"


def _status(state: FusedState, received_ns: int) -> Text:
    if stale := _stale(received_ns):
        return Text(stale, style="red")
    return Text(state.status, style=STYLES[state.status])


def _stale(received_ns: int) -> str:
    """That a state is old, in words; empty where it is not."""
    age_s = (time.time_ns() - received_ns) * 1e-9
    return f"stale: no state for {age_s:.0f} s" if age_s > STALE_S else ""


def _rate(health: Health) -> Text:
    """The rate of a unit's readings, beside the expected one where it is slower."""
    rate, expected = (
        sum(rate for name, rate in rates.items() if name.endswith("_reading"))
        for rates in (health.received_hz or health.sent_hz, health.expected_hz)
    )
    if rate < SLOW * expected:
        return Text(f"{rate:.0f} of {expected:.0f} Hz", style="yellow")
    return Text(f"{rate:.0f} Hz")


def _error(state: FusedState, truth: Truth) -> Error:
    inside = state.position_min_m <= truth.position_m <= state.position_max_m
    return Error(state.position_m - truth.position_m, state.speed_mps - truth.speed_mps, inside)


def run_watch(connect: Connection, train: str = "*") -> int:
    """Show the table of a train, or of all, until interrupted."""
    screen = Screen()

    def show_all() -> None:
        with listening(connect, STREAMS, train, screen.receive, screen.alive):
            show(screen, lambda: True, time.sleep)

    return until_interrupted(show_all)


def show(screen: Screen, going: Callable[[], bool], wait: Callable[[float], object]) -> None:
    """Draw the screen four times a second while `going()`; where there is no terminal, print lines once a second."""
    console = Console()
    if console.is_terminal:
        with Live(screen.render(), console=console, auto_refresh=False) as live:
            while going():
                live.update(screen.render(), refresh=True)
                wait(REFRESH_S)
        return
    while going():
        for line in screen.lines():
            print(line, flush=True)
        wait(1.0)
