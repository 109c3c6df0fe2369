"""The matrix as Markdown: who is hit down, what is done across, the longest time without a state in each cell."""

from __future__ import annotations

from collections.abc import Sequence

from .matrix import Outcome


def tables(outcomes: Sequence[Outcome]) -> str:
    """One table for each group of cells; a cell holds the longest gap in s, `failed` where a limit was not kept."""
    return "\n".join(_table(group) for group in _groups(outcomes))


def _groups(outcomes: Sequence[Outcome]) -> list[list[Outcome]]:
    """Those that have somebody hit or something done in common, directly or through others, stand together."""
    groups: list[list[Outcome]] = []
    for outcome in outcomes:
        akin = [group for group in groups if any(_akin(outcome, each) for each in group)]
        groups = [group for group in groups if group not in akin]
        groups.append([*(each for group in akin for each in group), outcome])
    return sorted(groups, key=lambda group: min(map(outcomes.index, group)))


def _akin(one: Outcome, other: Outcome) -> bool:
    return one.cell.hit == other.cell.hit or one.cell.what == other.cell.what


def _table(group: Sequence[Outcome]) -> str:
    across = list(dict.fromkeys(each.cell.what for each in group))
    found = {(each.cell.hit, each.cell.what): _cell(each) for each in group}
    rows = [["hit", *across], ["---"] * (len(across) + 1)]
    for hit in dict.fromkeys(each.cell.hit for each in group):
        rows.append([hit.rstrip(","), *(found.get((hit, what), "") for what in across)])
    return "".join(f"| {' | '.join(row)} |\n" for row in rows)


def _cell(outcome: Outcome) -> str:
    return f"{outcome.figures.gap_s:.2f}" if outcome.passed else "failed"
