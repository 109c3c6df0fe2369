"""The order of the rows that a truth is made of: one place at a time, time going forward."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple


class TruthRow(NamedTuple):
    """A row of a recording: its line in the file, its time, and where it says the train was, in any coordinates."""

    line: int
    t_s: float
    place: tuple[float, ...]

    def named(self, file: Path) -> str:
        """How an error names the row."""
        return f"{file}: line {self.line} ({self.t_s:.10g} s)"


def in_order(file: Path, rows: Iterable[TruthRow]) -> list[TruthRow]:
    """The rows at increasing times; one that repeats time and place of the row before it is left out.

    Raises ValueError naming file, line and time of a row that goes back in time, or is at another place at the same time.
    """
    out: list[TruthRow] = []
    for row in rows:
        last = out[-1] if out else None
        if last is None or row.t_s > last.t_s:
            out.append(row)
        elif row.t_s < last.t_s:
            raise ValueError(f"{row.named(file)}: time goes back, from {last.t_s:.10g} s in line {last.line}")
        elif row.place != last.place:
            raise ValueError(f"{row.named(file)}: the time of line {last.line} again, at another position")
    return out
