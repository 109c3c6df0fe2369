"""Makes a train of somebody's own logs: guesses the columns, shows them, writes the files and checks that they can be run."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from milepost.config.errors import ConfigError
from milepost.config.importing.files import SCENARIO, TRAIN
from milepost.config.importing.make import Made, make
from milepost.config.scenario_file import load_scenario
from milepost.recordings.importing.clocks import on_the_clock_of
from milepost.recordings.importing.columns import Column, LogColumns, Said, misfit, said
from milepost.recordings.importing.fields import NEEDED
from milepost.recordings.importing.log_file import LogFile, open_log
from milepost.recordings.importing.speed_unit import known_columns, shown_by
from milepost.recordings.importing.times import ISO

from ..showing.progress import progress_bar

BYTES_A_CELL = 8


def run_import(
    paths: Sequence[Path],
    line: Path | None,
    out: Path | None,
    columns: Sequence[str],
    units: Sequence[str],
    force: bool,
    as_json: bool,
) -> int:
    """Write the files and say what was found. Raises ConfigError before anything is written."""
    try:
        told = said(columns, units)
    except ValueError as error:
        raise ConfigError("import", "", str(error)) from error
    if twice := next((path for n, path in enumerate(paths) if path.resolve() in [each.resolve() for each in paths[:n]]), None):
        raise ConfigError(twice, "", "is named twice")
    logs, remarks = _with_columns([_opened(path) for path in paths], told)
    folder = out or Path(paths[0].stem)
    if folder.exists() and not folder.is_dir():
        raise ConfigError(folder, "", "is not a folder")
    with progress_bar("reading", float(sum(_rows(each) for each in logs))) as show:
        try:
            made = make(logs, line, folder, remarks, show)
        except ValueError as error:
            raise ConfigError(paths[0], "", str(error)) from error
    written = _write(made, folder, paths, force)
    _check(folder)
    if as_json:
        print(
            json.dumps({"columns": _found(logs), "unused": _unused(logs), **made.figures, "told": made.told, "files": written})
        )
    else:
        _show(logs, made, folder, written)
    return 0


def _opened(path: Path) -> LogFile:
    try:
        return open_log(path)
    except OSError as error:
        raise ConfigError(path, "", error.strerror or str(error)) from error
    except ValueError as error:
        raise ConfigError(path, "", str(error)) from error


def _with_columns(logs: Sequence[LogFile], told: Said) -> tuple[list[LogColumns], list[str]]:
    """The columns of all logs, that with places first, and remarks.

    Raises ConfigError for what is missing, naming the columns there are.
    """
    remarks: list[str] = []
    for field, names in told.columns.items():
        for name in names:
            if name and not any(name in log.header for log in logs):
                there = ", ".join(each for log in logs for each in log.header)
                raise ConfigError(logs[0].path, f"--column {field}", f"there is no column {name!r}; there are {there}")
    found = [LogColumns(log, _columns(log, told)) for log in logs]
    if len({each.columns[0].name for each in found if each.columns}) > 1 and "time" not in told.columns:
        found, remarks = _on_one_clock(logs, told, found)
    found.sort(key=lambda each: not {"latitude", "longitude"} <= {column.field for column in each.columns})
    found = [found[0], *(_shown_by(found[0], each, told) for each in found[1:])]
    for number, each in enumerate(found):
        for field in NEEDED if number == 0 else NEEDED[:1]:
            if not any(column.field == field for column in each.columns):
                raise ConfigError(each.log.path, field, _unknown(each.log, field))
    return found, remarks


def _unknown(log: LogFile, field: str) -> str:
    """Why no column is taken for a field, and what to say."""
    name = misfit(log, field)
    if name is None:
        return f"no column is known for it; there are {', '.join(log.header)}: name it with --column {field}=COLUMN"
    values = ", ".join(log.values(name)[:3]) or "it is empty"
    other = f"name another one with --column {field}=COLUMN, or the unit with --unit {field}=UNIT"
    return f"the column {name} does not hold it, by its values {values}: {other}"


def _on_one_clock(logs: Sequence[LogFile], told: Said, alone: list[LogColumns]) -> tuple[list[LogColumns], list[str]]:
    """The columns with a time column that all logs have; the receiver may have a clock of its own beside it.

    `alone`: what each log by itself was taken for.
    """
    for name in logs[0].header:
        if all(name in log.header for log in logs[1:]):
            try:
                common = Said({**told.columns, "time": [name]}, told.units)
                found = [LogColumns(log, known_columns(log, common)) for log in logs]
            except ValueError:
                continue  # a column that all have, and that is no time
            return _with_own_clock(found, alone)
    return alone, []


def _with_own_clock(found: list[LogColumns], alone: list[LogColumns]) -> tuple[list[LogColumns], list[str]]:
    out, remarks = [], []
    for each, own in zip(found, alone, strict=True):
        columns, shifted = each.columns, None
        if any(column.field == "latitude" for column in columns) and own.columns[0].name != columns[0].name:
            shifted = on_the_clock_of(each.log, own.columns[0], columns[0])
        if shifted is not None:
            columns = [shifted[0], *columns[1:]]
            remarks.append(shifted[1])
        out.append(LogColumns(each.log, columns))
    return out, remarks


def _columns(log: LogFile, told: Said) -> list[Column]:
    with _mistakes_of(log):
        return known_columns(log, told)


def _shown_by(fixes: LogColumns, each: LogColumns, told: Said) -> LogColumns:
    with _mistakes_of(each.log):
        return LogColumns(each.log, shown_by(fixes, each, told))


@contextmanager
def _mistakes_of(log: LogFile) -> Iterator[None]:
    """What is wrong with a log, as ConfigError that names it."""
    try:
        yield
    except ValueError as error:
        raise ConfigError(log.path, "", str(error)) from error


def _rows(each: LogColumns) -> float:
    """About how many rows a log has, from the length of its first ones."""
    sample = sum(len(cell) + 1 for row in each.log.sample for cell in row) / max(len(each.log.sample), 1)
    return each.log.path.stat().st_size / max(sample, 1.0)


def _write(made: Made, folder: Path, logs: Sequence[Path], force: bool) -> list[str]:
    """Write all files or none. Raises ConfigError where one is there already."""
    names = [*made.texts, *(copy.name for copy in made.copies)]
    for name in names:
        path = folder / name
        if any(path.exists() and path.samefile(log) for log in logs):
            raise ConfigError(path, "", "is a log itself; choose another folder with --out")
        if path.exists() and not force:
            raise ConfigError(path, "", "is there already; --force overwrites the files of an earlier import")
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in made.texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    for copy in made.copies:
        copy.write(folder)
    return [str(folder / name) for name in names]


def _check(folder: Path) -> None:
    """Whether what was written can be run: every recording is read to its end. Raises ConfigError."""
    _, train = load_scenario(folder / SCENARIO)
    assert train.recorded_end_s > 0.0


def _found(logs: Sequence[LogColumns]) -> list[dict[str, Any]]:
    return [
        {"log": str(each.log.path), "field": column.field, "column": column.name, "unit": column.unit, "found": column.why}
        for each in logs
        for column in each.columns
    ]


def _unused(logs: Sequence[LogColumns]) -> list[str]:
    used = {name for each in logs for column in each.columns for name in (column.name, column.date)}
    return [name for each in logs for name in each.log.header if name and name not in used]


def _show(logs: Sequence[LogColumns], made: Made, folder: Path, written: Iterable[str]) -> None:
    rows = [("field", "column", "unit", "found")]
    for each in logs:
        rows += [(column.field, column.name, _unit(column), column.why) for column in each.columns]
    widths = [max(len(row[at]) for row in rows) for at in range(3)]
    for row in rows:
        print("  ".join([*(cell.ljust(width) for cell, width in zip(row, widths, strict=False)), row[3]]))
    unused = _unused(logs)
    print("  ".join(["not used:", ", ".join(unused)]) if unused else "all columns are used")
    print()
    for sentence in made.told:
        print(sentence)
    print()
    print(f"written: {', '.join(written)}")
    print(f"run it:  milepost evaluate {folder / SCENARIO}")
    print(f"         milepost up --train {folder / TRAIN}")


def _unit(column: Column) -> str:
    return "ISO 8601" if column.unit == ISO else column.unit
