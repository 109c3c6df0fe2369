"""The matrix as a table of text."""

from __future__ import annotations

from collections.abc import Sequence

from .matrix import Outcome
from .soak import Soak

LOG_LINES = 20
COLUMNS = ("gap s", "limit", "stall", "error m", "outside", "missing", "twice", "refused", "recovery s")
# the longest name: a lie of a unit, and who is killed meanwhile
NAME_WIDTH = 52
HEAD = f"{'cell':<{NAME_WIDTH}} {' '.join(f'{name:>7}' for name in COLUMNS)}"


def row(outcome: Outcome) -> str:
    """One line of the table, and a line for each failure."""
    f = outcome.figures
    recovery = "never" if f.recovery_s is None else f"{f.recovery_s:.1f}"
    figures = f"{f.gap_s:7.2f} {outcome.cell.gap_s:7.2f} {f.stall_s:7.2f} {f.error_m:7.2f}"
    counts = f"{f.violations:7d} {f.missing:7d} {f.repeated:7d} {f.refused:7d}"
    verdict = "PASS" if outcome.passed else "FAIL"
    log = () if outcome.passed else tuple(f"    | {line}" for line in outcome.log[-LOG_LINES:])
    failures = (f"    {each}" for each in outcome.failures)
    return "\n".join([f"{outcome.cell.name:<{NAME_WIDTH}} {figures} {counts} {recovery:>10} {verdict}", *failures, *log])


def summary(outcomes: Sequence[Outcome]) -> str:
    """What all of them come to."""
    failed = sum(not each.passed for each in outcomes)
    outside = sum(each.figures.violations for each in outcomes)
    missing = sum(each.figures.missing for each in outcomes)
    return f"{len(outcomes)} cells, {failed} failed; {outside} interval violations, {missing} epochs missing"


def soak_text(out: Soak) -> str:
    """What came of a soak: its figures, the memory of each process, and what was not kept."""
    f = out.figures
    lines = [
        f"{out.minutes:g} min, seed {out.seed}: {len(out.blows)} blows, {f.states} states, {f.violations} interval violations",
        f"epochs missing: {f.missing}, outside the allowed gaps {out.missing_elsewhere}; twice or out of order: {f.repeated}",
        *(f"  {count} after {what}" for what, count in out.repeated_after.items()),
        f"largest error {f.error_m:.2f} m, longest gap {f.gap_s:.2f} s (stall {f.stall_s:.2f} s)",
        f"{'memory of its own, MB':<30} {'first':>8} {'last':>8}",
        *(f"{name:<30} {first:8.1f} {last:8.1f}" for name, (first, last) in out.memory_mb.items()),
        *out.failures,
        "PASS" if out.passed else "FAIL",
    ]
    return "\n".join(lines)
