"""A recording as a table: a CSV file read row by row, each cell by its own rule."""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, NamedTuple


@dataclass(frozen=True, slots=True)
class Cell:
    """Where a value stands and how its text is read; an empty cell is None where `optional`."""

    column: str
    read: Callable[[str], Any]
    optional: bool = False


class TableRow(NamedTuple):
    """A row by its line in the file: the values, or what cannot be read in it."""

    line: int
    values: dict[str, Any]
    error: str | None = None


def read_table(path: Path, cells: Mapping[str, Cell]) -> Iterator[TableRow]:
    """The rows of a CSV file with a header, values by the names in `cells`.

    A cell that cannot be read spoils its row alone. Raises ValueError naming file, line and column for a column that is
    not there, a row that is no CSV, and a file that is not UTF-8 text.
    """
    # a byte-order mark, which spreadsheets write, is not part of the first column's name
    with path.open(newline="", encoding="utf-8-sig") as file:
        rows = csv.DictReader(file)
        try:
            known = rows.fieldnames or []
            for cell in cells.values():
                if cell.column not in known:
                    raise ValueError(f"{path}: line 1: {cell.column}: missing; there are {', '.join(known)}")
            for row in rows:
                yield _row(rows.line_num, row, cells)
        except UnicodeDecodeError as error:
            raise ValueError(f"{path}: not UTF-8 text") from error
        except csv.Error as error:
            raise ValueError(f"{path}: line {rows.line_num + 1}: {error}") from error


def _row(line: int, row: Mapping[str, Any], cells: Mapping[str, Cell]) -> TableRow:
    values: dict[str, Any] = {}
    for name, cell in cells.items():
        text = row.get(cell.column)
        try:
            if text is None:
                raise ValueError("missing")
            values[name] = None if cell.optional and not text.strip() else cell.read(text)
        except ValueError as error:
            return TableRow(line, {}, f"line {line}: {cell.column}: {error}")
    return TableRow(line, values)


def utc_seconds(text: str) -> float:
    """Seconds since 1970 of an ISO 8601 time; UTC where it does not say."""
    time = datetime.fromisoformat(text.strip().replace("Z", "+00:00"))
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).timestamp()


def degrees(text: str, limit: float) -> float:
    """An angle within ±`limit`. Raises ValueError, also for what is not finite."""
    value = float(text)
    if not -limit <= value <= limit:
        raise ValueError(f"{text} is not within {limit:g} degrees of 0")
    return value
