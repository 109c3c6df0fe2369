"""A CSV file of any shape: its encoding, delimiter, decimal sign and header are found out."""

from __future__ import annotations

import codecs
import csv
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

DELIMITERS = ",;\t|"
SAMPLE_ROWS = 200
HEAD_BYTES = 1 << 18
DECIMAL_COMMA, DECIMAL_POINT = re.compile(r"[-+]?\d+,\d+$"), re.compile(r"[-+]?\d+\.\d+([eE][-+]?\d+)?$")
UBX, NMEA = re.compile(rb"\xb5\x62[\x01-\x40]"), re.compile(rb"\s*[$!][A-Z]{2}[A-Z]{3},")
NUMBER = re.compile(r"[-+]?\d+([.,]\d+)?([eE][-+]?\d+)?$")


@dataclass(frozen=True)
class LogFile:
    """A log: how it is written, its header, and its first rows.

    `skipped`: lines before the header. `plain`: a recording of a train file can name it as it is.
    """

    path: Path
    encoding: str
    delimiter: str
    decimal: str
    header: tuple[str, ...]
    sample: tuple[tuple[str, ...], ...]
    skipped: int
    marked: bool

    @property
    def plain(self) -> bool:
        """UTF-8, commas, decimal points, and the header in the first line."""
        return not self.oddities

    @property
    def oddities(self) -> list[str]:
        """What is unusual about it, in words."""
        found = [] if self.encoding == "utf-8-sig" else [f"text in {self.encoding}"]
        found += [] if self.delimiter == "," else ["tabs" if self.delimiter == "\t" else f"`{self.delimiter}` between columns"]
        found += [] if self.decimal == "." else ["decimal commas"]
        return found + (
            [f"{self.skipped} lines before the header"] if self.skipped else ["a marked header"] if self.marked else []
        )

    def values(self, column: str) -> list[str]:
        """The cells of a column in the first rows, without empty ones."""
        at = self.header.index(column)
        return [row[at].strip() for row in self.sample if len(row) > at and row[at].strip()]

    def number(self, text: str) -> float:
        """A cell as a number; NaN where it is none."""
        try:
            value = float(text.replace(",", ".") if self.decimal == "," else text)
        except ValueError:
            return math.nan
        return value if math.isfinite(value) else math.nan

    def rows(self, columns: Sequence[str]) -> Iterator[tuple[int, list[str]]]:
        """The number of each line with the cells of some columns. Raises ValueError for a file that is not text."""
        at = [self.header.index(column) for column in columns]
        with self.path.open(newline="", encoding=self.encoding) as file:
            reader = csv.reader(islice(file, self.skipped + 1, None), delimiter=self.delimiter)
            try:
                for row in reader:
                    if row:
                        yield reader.line_num + self.skipped + 1, [row[i].strip() if i < len(row) else "" for i in at]
            except (UnicodeDecodeError, csv.Error) as error:
                raise ValueError(f"line {reader.line_num + self.skipped + 2}: {error}") from error


def open_log(path: Path) -> LogFile:
    """Find out how a log is written. Raises ValueError where it is no table with a header, and OSError."""
    with path.open("rb") as file:
        head = file.read(HEAD_BYTES)
    _check_kind(head)
    encoding = _encoding(head)
    lines = head.decode(encoding, errors="replace").splitlines()
    lines = lines[:-1] if len(head) == HEAD_BYTES else lines
    skipped = next((i for i, line in enumerate(lines) if line.strip() and line.lstrip()[0] not in "#%"), len(lines))
    marked = False
    if 0 < skipped < len(lines) and _all_numbers(lines[skipped]):
        # the header itself is marked as a comment
        skipped, marked = skipped - 1, True
        lines[skipped] = lines[skipped].lstrip("#% \t")
    if skipped >= len(lines) - 1:
        raise ValueError("no table: neither a header nor rows")
    delimiter = max(DELIMITERS, key=lambda each: _regular(lines[skipped : skipped + 20], each))
    rows = [tuple(row) for row in csv.reader(lines[skipped : skipped + SAMPLE_ROWS + 1], delimiter=delimiter) if row]
    header = tuple(cell.strip() for cell in rows[0])
    _check_header(header)
    cells = [cell.strip() for row in rows[1:] for cell in row]
    commas, points = (sum(bool(each.match(cell)) for cell in cells) for each in (DECIMAL_COMMA, DECIMAL_POINT))
    decimal = "," if commas > points else "."
    return LogFile(path, encoding, delimiter, decimal, header, tuple(rows[1:]), skipped, marked)


def _check_kind(head: bytes) -> None:
    """Raises ValueError for what a receiver sends, which is no table."""
    kind = "UBX" if UBX.match(head) else "NMEA" if NMEA.match(head) else ""
    if kind:
        entry = f"receiver: {{protocol: {kind.lower()}, file: LOG}}"
        raise ValueError(f"is a receiver's own {kind} log, which needs no import: a unit of kind gnss reads it with `{entry}`")


def _encoding(head: bytes) -> str:
    if head[:2] in (b"\xff\xfe", b"\xfe\xff"):
        return "utf-16"
    try:
        # the last character may be cut
        codecs.getincrementaldecoder("utf-8")().decode(head)
    except UnicodeDecodeError:
        return "cp1252"
    return "utf-8-sig"


def _regular(lines: Sequence[str], delimiter: str) -> tuple[int, int]:
    """How well lines are split by a delimiter: how many rows are as long as the header, and how long that is."""
    rows = [row for row in csv.reader(lines, delimiter=delimiter) if row]
    width = len(rows[0]) if rows else 0
    return (0, 0) if width < 2 else (sum(len(row) == width for row in rows[1:]), width)


def _all_numbers(line: str) -> bool:
    first = re.split(r"[,;\t|]", line)
    return len(first) > 1 and all(NUMBER.match(cell.strip()) or not cell.strip() for cell in first)


def _check_header(header: tuple[str, ...]) -> None:
    if len(header) < 2:
        raise ValueError("no table: its first line is not divided by commas, semicolons, tabs or `|`")
    if any(NUMBER.match(cell) for cell in header):
        raise ValueError(f"no header: the first line is {', '.join(header[:8])}; put the names of the columns above it")
    for name in header:
        if name and header.count(name) > 1:
            raise ValueError(f"two columns are called {name}")
