"""The recording of a device with plain numbers: a wheel, an inertial unit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from ..units import UNITS
from .columns import Column
from .log_file import LogFile
from .rows import Rows, shifted, within
from .source import COPIED_TIME, Copy, Recording, Span, cell, own_time, reasons

SI = {"speed": "m/s", "acceleration": "m/s2", "turn rate": "rad/s"}


class Part(NamedTuple):
    """A number of a reading: where `Rows.values` has it, its column, and 1 or -1 where its axis is reversed."""

    key: str
    column: Column
    sign: float = 1.0


def value_recording(
    log: LogFile,
    columns: Sequence[Column],
    rows: Rows,
    span: Span,
    name: str,
    fields: Mapping[str, Part | list[Part]],
    constants: Mapping[str, Any],
) -> Recording:
    """The recording of the device `name` with its message's `fields`, each one number or a list of them."""
    why = reasons(log, columns, rows, span)
    if not why:
        return Recording(
            log.path, own_time(columns, span), {key: _own(of) for key, of in fields.items()}, dict(constants), None
        )
    used = shifted(within(rows, span.from_s, span.to_s), span.from_s)
    named = [
        (key if isinstance(of, Part) else f"{key}_{number}", part)
        for key, of in fields.items()
        for number, part in enumerate([of] if isinstance(of, Part) else of)
    ]
    written = [[cell(value * part.sign, 6) for value in used.values[part.key].tolist()] for _, part in named]
    times = [cell(t, 4) for t in used.t_s.tolist()]
    titles = {id(part): title for title, part in named}
    mapped = {key: _copied(of, titles) for key, of in fields.items()}
    copy = Copy(
        f"recorded-{name}.csv", ["t_s", *titles.values()], [*map(list, zip(times, *written, strict=True))], "; ".join(why)
    )
    return Recording(log.path, COPIED_TIME, mapped, dict(constants), copy)


def _own(of: Part | list[Part]) -> Any:
    if isinstance(of, list):
        return [_own(part) for part in of]
    return {"column": of.column.name, "unit": of.column.unit} | ({"scale": -1.0} if of.sign < 0.0 else {})


def _copied(of: Part | list[Part], titles: Mapping[int, str]) -> Any:
    if isinstance(of, list):
        return [_copied(part, titles) for part in of]
    return {"column": titles[id(of)], "unit": SI[UNITS[of.column.unit].quantity]}
