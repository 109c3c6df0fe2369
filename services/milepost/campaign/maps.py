"""The maps of a campaign: for each train its faults by its units, each cell marked with the worst that happened."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

from .aggregate import violated
from .text import shown

# found so soon is fast
FAST_S = 2.0


class Mark(NamedTuple):
    """How a cell looks on the map: the class that colours it, a symbol with a word, and a line below."""

    kind: str
    word: str
    below: str


def by_train(cells: Sequence[dict[str, Any]]) -> dict[str, list[dict[str, Any]]]:
    """The cells of each train, in the order of the campaign's file."""
    out: dict[str, list[dict[str, Any]]] = {}
    for cell in cells:
        out.setdefault(cell["train"], []).append(cell)
    return out


def grid(cells: Sequence[dict[str, Any]]) -> tuple[dict[tuple[str, str], Mark], list[str], list[str]]:
    """A train's map by row and column, its rows and its columns: faults by units; where two units lie, one by the other."""
    marks = {(_row(cell), _column(cell)): mark(cell) for cell in cells}
    rows, columns = (list(dict.fromkeys(place[i] for place in marks)) for i in (0, 1))
    return marks, rows, columns


def as_markdown(cells: Sequence[dict[str, Any]]) -> str:
    """The maps of all trains as Markdown tables."""
    return "\n".join(_table(train, own) for train, own in by_train(cells).items())


def _table(train: str, cells: Sequence[dict[str, Any]]) -> str:
    marks, rows, columns = grid(cells)
    lines = [("", *columns), ("---",) * (1 + len(columns))]
    lines += [(row, *(_text(marks.get((row, column))) for column in columns)) for row in rows]
    return "\n".join([f"### {train}", "", *("| " + " | ".join(line) + " |" for line in lines), ""])


def _text(found: Mark | None) -> str:
    return "" if found is None else f"{found.word} {found.below}".strip()


def mark(cell: dict[str, Any]) -> Mark:
    """The mark of a cell: the worst that happened comes first."""
    innocents = "! " + ", ".join(cell["wrongly_excluded"]) if cell["wrongly_excluded"] else ""
    if cell["crashed_runs"]:
        return Mark("outside", f"✗ {cell['crashed_runs']}/{cell['runs']} crashed", innocents)
    if violated(cell):
        error = f"{shown(_worst_error_m(cell))} m"
        return Mark("outside", f"✗ {cell['violation_runs']}/{cell['runs']}", f"{error} {innocents}".strip())
    if not cell["units"]:
        return Mark("held", "– held", innocents)
    found, found_s = cell["detected_percent"], cell["time_to_detect_p50_s"]
    if found is None:  # in no run was there anything for the fault to act on
        return Mark("held", "– never acted", innocents)
    if found < 100.0:
        known = "doubted" if cell["doubted_percent"] == 100.0 else "warned of" if cell["warned_percent"] == 100.0 else ""
        return Mark("unseen", f"? found in {found:.0f} %" if found else "? not found", f"{known} {innocents}".strip())
    return Mark("fast" if found_s <= FAST_S else "slow", f"✓ {shown(found_s)} s", innocents)


def _worst_error_m(cell: dict[str, Any]) -> float | None:
    errors = (cell["position_error_during_max_m"], cell["position_error_after_max_m"])
    return max((error for error in errors if error is not None), default=None)


def _row(cell: dict[str, Any]) -> str:
    return str(cell["units"][0] if len(cell["units"]) == 2 else cell["fault"])


def _column(cell: dict[str, Any]) -> str:
    return str(cell["units"][-1]) if cell["units"] else "all units"
