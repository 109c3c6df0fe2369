"""Evaluations as text: the estimators of one scenario, and all judged claims."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from milepost.checks.table import check_lines

from .claims import JudgedClaim, SeedStatistics
from .scores import BASIC, BASIC_WITHOUT_TRUTH

HEADINGS = ("source", "scenario", "figure", "its claim", "its method here", "Milepost here", "optimum here", "target", "met")
VERDICT = {True: "yes", False: "NO", None: "-"}


def estimator_table(result: dict[str, Any]) -> str:
    """The basic figures, a line for each estimator; the figures of the whole run; a table of checks; then the variants."""
    lines = [f"{result['scenario']}: seed {result['seed']}, {result['duration_s']:g} s, {result.get('runs', 1)} run(s)"]
    lines += _condition(result, result.get("runs", 1))
    for name, variant in result.get("variants", {}).items():
        lines += ["", f"{result['scenario']}, {name}", *_condition(variant, result.get("runs", 1))]
    return "\n".join(lines)


def _condition(result: dict[str, Any], runs: int) -> list[str]:
    columns = tuple(BASIC_WITHOUT_TRUTH) if "not_scored" in result else BASIC
    width = max(17, *map(len, columns)) + 1
    lines = [f"{'':14}" + "".join(f"{key:>{width}}" for key in columns)]
    for name, figures in result["estimators"].items():
        lines.append(f"{name:14}" + "".join(_cell(figures.get(key), width) for key in columns))
    for name, figures in result["estimators"].items():
        requested = {key: value for key, value in figures.items() if key not in (*columns, "worst")}
        if requested:
            lines.append(f"{name}: " + ", ".join(f"{key} {shown(value)}" for key, value in requested.items()))
    if "not_scored" in result:
        lines.append(result["not_scored"])
    if "ended_s" in result:
        why = "where the train was 50 m before the end of its line, or its recordings ended"
        lines.append(f"ended after {result['ended_s']:.1f} s, {why}")
    alone = {key: value for key, value in result.items() if isinstance(value, (int, float))}
    lines += [f"{key}: {value:.9g}" for key, value in alone.items() if key not in ("seed", "duration_s", "ended_s", "runs")]
    return lines + [line for name, found in result.get("checks", {}).items() for line in ("", *check_lines(name, found, runs))]


def _cell(figure: float | None, width: int) -> str:
    return f"{'-':>{width}}" if figure is None else f"{figure:{width}.5f}"


def claims_table(rows: Sequence[JudgedClaim]) -> str:
    """A line for each claim; below a claim that is not met, the reason."""
    cells = [HEADINGS, *(row_cells(row) for row in rows)]
    widths = [max(len(row[i]) for row in cells) for i in range(len(HEADINGS))]
    lines = ["  ".join(f"{cell:{width}}" for cell, width in zip(row, widths, strict=True)).rstrip() for row in cells]
    out = [lines[0], "-" * len(lines[0])]
    for row, line in zip(rows, lines[1:], strict=True):
        out.append(line)
        if row.met is False:
            out.append(f"    not met: {row.why or 'no reason in the scenario file'}")
    return "\n".join(out)


def row_cells(row: JudgedClaim) -> tuple[str, ...]:
    """The cells of a claim, in the order of the headings."""
    spreads = [statistics_shown(spread) for spread in (row.method, row.ours, row.optimum)]
    return (row.source, row.scenario, row.label, row.says, *spreads, row.target, VERDICT[row.met])


def statistics_shown(spread: SeedStatistics | None) -> str:
    """The median or the pooled value, and the worst in brackets; a dash where the figure is missing."""
    if spread is None:
        return "-"
    return with_worst(spread.median if spread.pooled is None else spread.pooled, spread.worst)


def with_worst(median: Any, worst: Any) -> str:
    """A figure, and its worst value in brackets where the two differ."""
    return shown(median) if shown(median) == shown(worst) else f"{shown(median)} ({shown(worst)})"


def flat(figures: Mapping[str, Any]) -> dict[str, float]:
    """Figures with the entries of maps and lists as figures of their own, named `key.entry` as in claims."""
    out: dict[str, float] = {}
    for key, value in figures.items():
        entries = value.items() if isinstance(value, dict) else enumerate(value) if isinstance(value, list) else None
        out |= {key: value} if entries is None else {f"{key}.{place}": entry for place, entry in entries}
    return out


def shown(value: Any) -> str:
    """A figure, or a map or a list of figures, as text."""
    if isinstance(value, dict):
        return " ".join(f"{key}: {shown(entry)}" for key, entry in value.items())
    if isinstance(value, list):
        return " ".join(shown(entry) for entry in value)
    return f"{value:.3g}"
