"""A recording as tables, one for each stream: CSV, or Parquet."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import IO, Any, get_args, get_origin

from pydantic import BaseModel

from milepost_schemas import STREAMS, Message, Stream

from .columns import Column, columns_of, plain

# rows of a Parquet group
GROUP = 10_000


def _cleared(folder: Path, suffix: str) -> Path:
    """The folder, without the tables of an earlier export: what lies in it is of one recording, or one part of it."""
    folder.mkdir(parents=True, exist_ok=True)
    for row in STREAMS:
        (folder / f"{row.name}{suffix}").unlink(missing_ok=True)
    return folder


class CsvTables:
    """`STREAM.csv` in a folder."""

    def __init__(self, folder: Path) -> None:
        self._folder = _cleared(folder, ".csv")
        self._tables: dict[str, tuple[IO[str], Any, list[Column]]] = {}
        self.written = [folder]

    def add(self, row: Stream, message: Message, fields: dict[str, Any], at_ns: int) -> None:
        """Append a message. Raises OSError."""
        del message, at_ns
        if row.name not in self._tables:
            self._begin(row)
        _, table, columns = self._tables[row.name]
        table.writerow([_text(column.of(fields)) for column in columns])

    def _begin(self, row: Stream) -> None:
        path, columns = self._folder / f"{row.name}.csv", columns_of(row.message)
        file = path.open("w", encoding="utf-8", newline="")
        table = csv.writer(file)
        table.writerow([column.name for column in columns])
        self._tables[row.name] = (file, table, columns)

    def close(self) -> None:
        """Finish the files."""
        for file, _, _ in self._tables.values():
            file.close()


def _text(value: Any) -> Any:
    """What a cell holds: an empty one is None, JSON where it is no single value. Floats keep every digit."""
    if isinstance(value, list | dict):
        return json.dumps(value, separators=(",", ":"))
    return repr(value) if isinstance(value, float) else value


class ParquetTables:
    """`STREAM.parquet` in a folder, with the types of the schema."""

    def __init__(self, folder: Path) -> None:
        self._folder = _cleared(folder, ".parquet")
        self._tables: dict[str, _ParquetTable] = {}
        self.written = [folder]

    def add(self, row: Stream, message: Message, fields: dict[str, Any], at_ns: int) -> None:
        """Append a message. Raises OSError."""
        del message, at_ns
        table = self._tables.get(row.name)
        if table is None:
            table = self._tables[row.name] = _ParquetTable(self._folder / f"{row.name}.parquet", columns_of(row.message))
        table.add(fields)

    def close(self) -> None:
        """Finish the files."""
        for table in self._tables.values():
            table.close()


class _ParquetTable:
    def __init__(self, path: Path, columns: list[Column]) -> None:
        import pyarrow as pa
        import pyarrow.parquet as pq

        self._columns = columns
        self._schema = pa.schema([(column.name, _arrow(column.kind)) for column in columns])
        self._writer = pq.ParquetWriter(path, self._schema, compression="zstd")
        self._rows: list[dict[str, Any]] = []

    def add(self, fields: dict[str, Any]) -> None:
        self._rows.append({c.name: _cell(c.of(fields), c.kind) for c in self._columns})
        if len(self._rows) >= GROUP:
            self._write()

    def _write(self) -> None:
        import pyarrow as pa

        self._writer.write_table(pa.Table.from_pylist(self._rows, self._schema))
        self._rows.clear()

    def close(self) -> None:
        if self._rows:
            self._write()
        self._writer.close()


def _arrow(kind: Any) -> Any:
    """A type of the schema as Arrow has it; text where the schema leaves it open."""
    import pyarrow as pa

    kind = plain(kind)
    single = {int: pa.int64(), float: pa.float64(), bool: pa.bool_(), bytes: pa.binary()}
    if kind in single:
        return single[kind]
    if get_origin(kind) is list:
        return pa.list_(_arrow(get_args(kind)[0]))
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return pa.struct([(name, _arrow(field.annotation)) for name, field in kind.model_fields.items()])
    if get_origin(kind) is dict and plain(get_args(kind)[1]) in single:
        return pa.map_(pa.string(), _arrow(get_args(kind)[1]))
    return pa.string()


def _cell(value: Any, kind: Any) -> Any:
    """A value as Arrow takes it."""
    kind = plain(kind)
    if value is None or kind in (int, bool, str, bytes):
        return value
    if kind is float:
        return float(value)
    if get_origin(kind) is list:
        return [_cell(each, get_args(kind)[0]) for each in value]
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return {name: _cell(value.get(name), field.annotation) for name, field in kind.model_fields.items()}
    if get_origin(kind) is dict and isinstance(value, dict) and plain(get_args(kind)[1]) in (int, float, bool):
        return [(name, _cell(each, get_args(kind)[1])) for name, each in value.items()]
    return json.dumps(value, separators=(",", ":"))
