"""The report of a campaign: one page with a map of each train's cells and all figures, and the same as JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any, NamedTuple

from .aggregate import violated
from .campaign import Campaign
from .text import HEADINGS, row_cells, shown, verdict

PAGE = Path(__file__).with_name("report.html")
# found so soon is fast
FAST_S = 2.0
# a list of more failed runs than this is not read; results.json has all of them
MOST_FAILED = 200
CODE = re.compile(r"`([^`]+)`")


class Mark(NamedTuple):
    """How a cell looks on the map: the class that colours it, a symbol with a word, and a line below."""

    kind: str
    word: str
    below: str


def write_report(folder: Path, campaign: Campaign) -> None:
    """Write `index.html`, which needs no other file, and `results.json` into a folder, which is made if there is none."""
    folder.mkdir(parents=True, exist_ok=True)
    page = Template(PAGE.read_text(encoding="utf-8")).substitute(
        name=escape(campaign.file.campaign),
        about=CODE.sub(r"<code>\1</code>", escape(campaign.file.about)),
        verdict=escape(verdict(campaign)),
        **{"class": "bad" if campaign.violated else "good"},
        maps="\n".join(
            _map(train, [cell for cell in campaign.cells if cell["train"] == train]) for train in campaign.file.trains
        ),
        runs=campaign.runs,
        seed=campaign.seed,
        code=campaign.as_dict()["code"],
        table=_table(campaign),
        innocents=_innocents(campaign),
        failed=_failed(campaign),
    )
    (folder / "index.html").write_text(page, encoding="utf-8")
    (folder / "results.json").write_text(json.dumps(campaign.as_dict(), indent=1) + "\n", encoding="utf-8")


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


def _map(train: str, cells: Sequence[dict[str, Any]]) -> str:
    """A train's map: faults by units; where two units lie, the first by the second."""
    marks = {(_row(cell), _column(cell)): mark(cell) for cell in cells}
    rows, columns = (list(dict.fromkeys(place[i] for place in marks)) for i in (0, 1))
    lines = ['<tr><td style="visibility:hidden"></td>' + "".join(f"<th>{escape(column)}</th>" for column in columns) + "</tr>"]
    for row in rows:
        inside = "".join(_cell(marks.get((row, column))) for column in columns)
        lines.append(f'<tr><th scope="row">{escape(row)}</th>{inside}</tr>')
    return f'<h2>{escape(train)}</h2><div class="wide"><table class="map">{"".join(lines)}</table></div>'


def _row(cell: dict[str, Any]) -> str:
    return str(cell["units"][0] if len(cell["units"]) == 2 else cell["fault"])


def _column(cell: dict[str, Any]) -> str:
    return str(cell["units"][-1]) if cell["units"] else "all units"


def _cell(found: Mark | None) -> str:
    if found is None:
        return "<td></td>"
    below = f"<small>{escape(found.below)}</small>" if found.below else ""
    return f'<td class="{found.kind}"><b>{escape(found.word)}</b>{below}</td>'


def _table(campaign: Campaign) -> str:
    lines = [_line(HEADINGS, "th")]
    lines += [_line(row_cells(cell), "td", "outside" if violated(cell) else "") for cell in campaign.cells]
    return "\n".join(lines)


def _line(cells: Sequence[str], tag: str, kind: str = "") -> str:
    inside = "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells)
    return f'<tr class="{kind}">{inside}</tr>' if kind else f"<tr>{inside}</tr>"


def _innocents(campaign: Campaign) -> str:
    """Which units without a fault were excluded, how often, and why."""
    rows = [
        (cell["train"], " + ".join(cell["units"]) or "-", cell["fault"], unit, f"{entry['runs']}", shown(entry["percent"]),
         "; ".join(entry["reasons"]))
        for cell in campaign.cells
        for unit, entry in cell["wrongly_excluded"].items()
    ]  # fmt: skip
    headings = ("train", "units", "fault", "excluded", "runs", "epochs %", "reasons")
    return _details(f"Units without a fault that were excluded ({len(rows)})", headings, rows)


def _failed(campaign: Campaign) -> str:
    """The runs with a violation or a crash: what is needed to make each again."""
    rows = [
        (
            cell["train"],
            f"{run['seed']}",
            "; ".join(f"{fault['unit']}: {label}" for fault, label in zip(run["faults"], run["labels"], strict=True)) or "-",
            run.get("crashed") or f"outside in {run['outside_epochs']} epochs from {shown(run['first_outside_s'])} s on",
        )
        for cell in campaign.cells
        for run in cell["failed_runs"]
    ]
    title = f"Runs with a violation ({len(rows)}" + (f", the first {MOST_FAILED})" if len(rows) > MOST_FAILED else ")")
    return _details(title, ("train", "seed", "faults", "what happened"), rows[:MOST_FAILED])


def _details(title: str, headings: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    if not rows:
        return ""
    inside = "\n".join([_line(headings, "th"), *(_line(row, "td") for row in rows)])
    return (
        f'<details><summary>{escape(title)}</summary><div class="wide"><table class="figures">{inside}</table></div></details>'
    )
