"""A campaign as text: a line for each cell, with the figures that compare."""

from __future__ import annotations

from typing import Any

from .campaign import Campaign

HEADINGS = (
    "train", "units", "fault", "runs", "outside", "outside %", "normal %", "detected %", "detect s, p50", "p95", "used again %",
    "innocents %", "exclusions/h", "error m", "after m", "half-width m", "largest m", "recover s", "SUBSET-041 %",
)  # fmt: skip


def verdict(campaign: Campaign) -> str:
    """One sentence: in how many runs and cells the truth left an interval."""
    cells, bad = campaign.cells, campaign.violated
    runs, failed = sum(cell["runs"] for cell in cells), sum(cell["violation_runs"] for cell in cells)
    crashed = sum(cell["crashed_runs"] for cell in cells)
    text = f"The truth left an interval in {failed} of {runs} runs, in {len(bad)} of {len(cells)} cells."
    return text + (f" A node crashed in {crashed} runs." if crashed else "")


def row_cells(cell: dict[str, Any]) -> tuple[str, ...]:
    """The cells of a line, in the order of the headings."""
    outside = f"{cell['violation_runs']}" + (f" + {cell['crashed_runs']} crashed" if cell["crashed_runs"] else "")
    return (
        cell["train"],
        " + ".join(cell["units"]) or "-",
        cell["fault"],
        f"{cell['runs']}",
        outside,
        *(
            shown(cell[name])
            for name in (
                "violation_epochs_percent",
                "normal_while_outside_percent",
                "detected_percent",
                "time_to_detect_p50_s",
                "time_to_detect_p95_s",
                "used_again_percent",
                "wrongly_excluded_percent",
                "wrong_exclusions_per_h",
                "position_error_during_max_m",
                "position_error_after_max_m",
                "position_half_width_median_m",
                "position_half_width_max_m",
                "time_to_recover_p50_s",
                "subset_041_percent",
            )
        ),
    )


def table(campaign: Campaign) -> str:
    """The table of all cells and the verdict."""
    rows = [HEADINGS, *(row_cells(cell) for cell in campaign.cells)]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEADINGS))]
    lines = ["  ".join(f"{text:{width}}" for text, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([lines[0], "-" * len(lines[0]), *lines[1:], "", verdict(campaign)])


def shown(value: float | None) -> str:
    """A figure with three digits; a dash where there is none."""
    if value is None:
        return "-"
    return f"{value:.0f}" if abs(value) >= 1000.0 else f"{value:.3g}"
