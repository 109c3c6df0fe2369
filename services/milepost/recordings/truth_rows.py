"""The order of the rows of a truth: times increase, and each time has one position."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple


class TruthRow(NamedTuple):
    """A row of a recording: its line in the file, its time, and its position in any coordinates."""

    line: int
    t_s: float
    place: tuple[float, ...]

    def named(self, file: Path) -> str:
        """The row's name in an error."""
        return f"{file}: line {self.line} ({self.t_s:.10g} s)"


def in_order(file: Path, rows: Iterable[TruthRow]) -> list[TruthRow]:
    """The rows at increasing times, without those that repeat time and position of the row before.

    Raises ValueError naming file, line and time of a row that is earlier than the row before, or at its time and at another
    position.
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
