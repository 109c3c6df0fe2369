"""Faults that a person may inject from the page: which fit a unit, and which options they have."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, get_args

from milepost.simulation.faults import FAULTS
from milepost_schemas import BY_NAME, Health, Message

from .heard import TrainHeard

SENSOR = "sensor-"


class Answer(NamedTuple):
    """What a sensor answered."""

    done: bool
    text: str


@dataclass(frozen=True)
class Order:
    """A fault for a unit of a train; without a fault, the end of all. `options` are words as on the command line."""

    train: str
    unit: str
    fault: str = ""
    options: Sequence[str] = ()
    for_s: float | None = None


class Injecting(Protocol):
    """Asks trains."""

    def allowed(self, train: str) -> bool:
        """Whether a train takes faults. May wait."""
        ...

    def send(self, order: Order) -> Answer:
        """Have a sensor lie, or stop lying. Waits for the answer."""
        ...


class Option(NamedTuple):
    """An option of a fault: its name, what it says, what kind of input it takes, its default."""

    name: str
    about: str
    kind: str
    default: Any
    required: bool


def units_of(train: TrainHeard) -> list[str]:
    """The units of a train whose sensors live."""
    return sorted({unit.removeprefix(SENSOR) for unit, _ in set(train.tokens) if unit.startswith(SENSOR)})


def faults_for(health: Health | None) -> dict[str, str]:
    """The faults that fit what a sensor sends, each with what it does; all, where that is not known."""
    sent = set() if health is None else {*health.sent_hz, *health.expected_hz} & _reading_streams()
    return {
        row.name: f"{row.name.replace('_', ' ')}: {row.purpose}" for row in FAULTS.values() if not sent or sent & {*row.streams}
    }


def options_of(fault: str) -> list[Option]:
    """The options of a fault."""
    out = []
    for name, field in FAULTS[fault].options.model_fields.items():
        kinds = {field.annotation, *get_args(field.annotation)}
        kinds |= {part for each in kinds for part in get_args(each)}
        kind = "flag" if bool in kinds else "number" if float in kinds or int in kinds else "word"
        required = field.is_required()
        out.append(Option(name, field.description or name, kind, None if required else field.default, required))
    return out


def words_of(options: Sequence[Option], values: dict[str, Any]) -> list[str]:
    """Values as options on a command line; what is empty is left out."""
    out = []
    for option in options:
        value, typed = values.get(option.name), option.name.replace("_", "-")
        if option.kind == "flag":
            out.append(f"--{typed}" if value else f"--no-{typed}")
        elif value not in (None, ""):
            out.append(f"--{typed}={value:g}" if isinstance(value, float) else f"--{typed}={value}")
    return out


def _reading_streams() -> set[str]:
    return {name for name, row in BY_NAME.items() if issubclass(row.message, Message) and row.key.startswith("reading/")}
