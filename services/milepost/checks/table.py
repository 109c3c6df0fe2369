"""The checks of one estimator as a table of text, at most 100 columns wide."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from .requirements import CHECKS

HEADINGS = ("", "unit", "violations", "share", "worst", "median", "p95", "max", "available")
WIDTHS = (21, 5, 11, 9, 10, 10, 10, 10, 11)
UNITS = {"m": "m", "mps": "m/s", "s": "s"}


def check_lines(estimator: str, checks: Mapping[str, Mapping[str, Any]], runs: int) -> list[str]:
    """A title, the headings, and a line for each check."""
    title = f"checks of {estimator}" + (f", the worst of {runs} runs" if runs > 1 else "")
    return [title, *(_line(cells) for cells in (HEADINGS, *check_rows(checks)))]


def check_rows(checks: Mapping[str, Mapping[str, Any]]) -> list[tuple[str, ...]]:
    """The cells of each check that applies everywhere: of many seeds the worst figures; a dash for what there is not."""
    return [_cells(name, checks.get(name, {})) for name, check in CHECKS.items() if check.always]


def _cells(name: str, figures: Mapping[str, Any]) -> tuple[str, ...]:
    check, shown = CHECKS[name], figures.get("worst", figures)
    sizes = [_number(shown.get(f"{check.size}_{key}_{check.unit}")) for key in ("median", "p95", "max")]
    violations = _number(shown.get("violations"))
    worst, share = _number(shown.get(f"worst_{check.unit}")), _percent(shown.get("violations_share"))
    return (name, UNITS[check.unit], violations, share, worst, *sizes, _percent(shown.get("availability")))


def _number(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.0f}" if isinstance(value, int) or abs(value) >= 1e4 else f"{value:.3g}"


def _percent(value: float | None) -> str:
    """Rounded down: only all of the epochs are 100 %."""
    return "-" if value is None else f"{math.floor(1e4 * value + 1e-6) / 100.0:.2f} %"


def _line(cells: tuple[str, ...]) -> str:
    first, *others = (
        f"{cell:<{width}}" if i < 2 else f"{cell:>{width}}" for i, (cell, width) in enumerate(zip(cells, WIDTHS, strict=True))
    )
    return "".join([first, *others]).rstrip()
