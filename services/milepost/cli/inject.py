"""`milepost inject`: make a sensor of a running train lie, or harm a fuser: its belief, or its clock."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, get_args

from pydantic.fields import FieldInfo

from milepost.config.errors import ConfigError
from milepost.config.mistakes import one_of
from milepost.config.ranges import limits_of, range_of
from milepost.nodes.fuser_faults.table import FUSER_FAULTS, options_from
from milepost.recordings.options import nearest
from milepost.runtime.bus import NoRouterError
from milepost.runtime.injecting.commands import NoAnswerError, send_command
from milepost.runtime.zenoh_config import Connection
from milepost.simulation.faults import FAULTS, FaultEntry, FaultKind, reason_of

KINDS = {**FAULTS, **FUSER_FAULTS}
NO = "no_"


@dataclass(frozen=True)
class Wanted:
    """What the command line asks for; `options`: those of the fault, as they were typed. `train` may be empty."""

    unit: str
    fault: str
    options: Sequence[str]
    for_s: float | None
    clear: bool
    train: str


def run_inject(wanted: Wanted, connect: Connection, as_json: bool) -> int:
    """Send the command and show the sensor's answer. 0: done; 1: nobody there; 2: refused. Raises ConfigError."""
    fields = fields_of(wanted)
    try:
        answer = send_command(connect, wanted.train, wanted.unit, fields)
    except (NoRouterError, NoAnswerError) as error:
        print(f"milepost: {error}", file=sys.stderr)
        return 1
    refused = answer.code == "fault_refused"
    text = answer.text.rpartition(" (")[0]
    if as_json:
        print(json.dumps({"train": answer.train, "unit": answer.unit, "done": not refused, "answer": text, **fields}))
    else:
        print(f"milepost: {answer.train}: {text}", file=sys.stderr if refused else sys.stdout)
    return 2 if refused else 0


def fields_of(wanted: Wanted) -> dict[str, Any]:
    """The fields of the command that is sent. Raises ConfigError."""
    if not wanted.unit or wanted.unit.startswith("-"):
        raise ConfigError("inject", "UNIT", "required; a fault's options come after UNIT and FAULT")
    if wanted.clear:
        if wanted.fault or wanted.options or wanted.for_s is not None:
            raise ConfigError("inject", "--clear", "ends all faults of a unit; name no other")
        return {}
    if wanted.fault not in KINDS:
        raise ConfigError("inject", "FAULT", one_of(KINDS, wanted.fault))
    options = _options(KINDS[wanted.fault], wanted.options)
    try:
        if wanted.fault in FUSER_FAULTS:
            options_from(wanted.fault, options, wanted.for_s)
        else:
            FaultEntry.model_validate(
                {"unit": wanted.unit, "kind": wanted.fault, "from_s": 0.0, "for_s": wanted.for_s, **options}
            )
    except ValueError as error:
        raise ConfigError("inject", wanted.fault, _as_typed(reason_of(error), KINDS[wanted.fault])) from error
    return {
        "kind": wanted.fault,
        "for_s": wanted.for_s,
        "numbers": {name: float(v) for name, v in options.items() if isinstance(v, int | float) and not isinstance(v, bool)},
        "words": {name: v for name, v in options.items() if isinstance(v, str)},
        "flags": {name: v for name, v in options.items() if isinstance(v, bool)},
    }


def _options(row: FaultKind, typed: Sequence[str]) -> dict[str, Any]:
    """The options of a fault from `--name value`, `--name=value` and, of flags, `--name` or `--no-name`. Raises ConfigError."""
    known, out, left = row.options.model_fields, {}, list(typed)
    while left:
        word, given, value = left.pop(0).partition("=")
        name = word.removeprefix("--").replace("-", "_")
        on = not (name.startswith(NO) and name not in known)
        name = name if on else name.removeprefix(NO)
        if not word.startswith("--") or name not in known or not (on or _is_flag(known[name])):
            raise ConfigError("inject", "", _not_an_option(row.name, word, known))
        if _is_flag(known[name]):
            if given:
                raise ConfigError("inject", word, f"takes no value; {_typed(NO + name)} is its opposite")
            out[name] = on
            continue
        if not given:
            if not left:
                raise ConfigError("inject", word, "needs a value")
            value = left.pop(0)
        out[name] = _value(word, known[name], value)
    return out


def _not_an_option(kind: str, word: str, known: Iterable[str]) -> str:
    typed = [_typed(name) for name in known]
    return f"{word}: not an option of {kind}, which has {', '.join(typed) or 'none'}{nearest(word, typed)}"


def _as_typed(reason: str, row: FaultKind) -> str:
    """A reason that begins with the option as it is typed, where it is about one: `--size: required`."""
    name, colon, text = reason.partition(": ")
    return f"{_typed(name)}: {text}" if colon and name in row.options.model_fields else reason


def _typed(name: str) -> str:
    return f"--{name.replace('_', '-')}"


def _kinds(field: FieldInfo) -> set[Any]:
    return {field.annotation, *get_args(field.annotation)}


def _is_flag(field: FieldInfo) -> bool:
    return bool in _kinds(field)


def _value(option: str, field: FieldInfo, text: str) -> Any:
    kinds = _kinds(field)
    if float not in kinds and int not in kinds:
        return text
    try:
        return int(text) if int in kinds else float(text)
    except ValueError:
        what = "a whole number" if int in kinds else "a number"
        raise ConfigError("inject", option, f"must be {what}, not {text!r}") from None


def run_list(wanted: Wanted, as_json: bool) -> int:
    """Show the table of faults. Raises ConfigError for a unit or a fault beside it: the table is that of all."""
    if wanted.unit or wanted.fault or wanted.clear:
        beside = "--clear" if wanted.clear else wanted.unit or wanted.fault
        raise ConfigError("inject", "--list", f"shows the faults of all units; leave out {beside}")
    if as_json:
        print(json.dumps([_row(row) for row in KINDS.values()]))
        return 0
    for row in KINDS.values():
        fits = ", ".join(row.sensors or row.streams) + (", simulated" if row.needs_motion else "")
        print(f"{row.name:<14} {row.purpose} [{fits}]")
        schemas = row.options.model_json_schema()["properties"] if row.options.model_fields else {}
        for name, field in row.options.model_fields.items():
            print(f"    {_shown(name, field):<18} {field.description}{_allowed(field, range_of(schemas[name]))}")
    return 0


def _shown(name: str, field: FieldInfo) -> str:
    return f"{_typed(name)}/{_typed(NO + name)}" if _is_flag(field) else _typed(name)


def _allowed(field: FieldInfo, limits: str) -> str:
    """` (> 0, required)`, ` (default 2.0)`; empty where there is nothing to say."""
    default = "required" if field.is_required() else "" if field.default is None else f"default {field.default}"
    if _is_flag(field):
        default = "default on" if field.default else "default off"
    words = [each for each in (limits, default) if each]
    return f" ({', '.join(words)})" if words else ""


def _row(row: FaultKind) -> dict[str, Any]:
    schemas = row.options.model_json_schema()["properties"] if row.options.model_fields else {}
    options = {
        name: {"about": field.description, "required": field.is_required()}
        | ({} if field.is_required() else {"default": field.default})
        | limits_of(schemas[name])
        for name, field in row.options.model_fields.items()
    }
    return {"fault": row.name, "about": row.purpose, "streams": row.streams, "sensors": row.sensors, "options": options}
