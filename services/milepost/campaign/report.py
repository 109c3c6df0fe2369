"""The report of a campaign: one page with a map of each train's cells and all figures; the maps as Markdown, all as JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from .aggregate import violated
from .campaign import Campaign
from .maps import Mark, as_markdown, by_train, grid
from .text import HEADINGS, row_cells, shown, verdict

PAGE = Path(__file__).with_name("report.html")
# a list of more failed runs than this is not read; results.json has all of them
MOST_FAILED = 200
CODE = re.compile(r"`([^`]+)`")


def write_report(folder: Path, campaign: Campaign) -> None:
    """Write `index.html`, which needs no other file, `maps.md` and `results.json` into a folder, made if there is none."""
    folder.mkdir(parents=True, exist_ok=True)
    page = Template(PAGE.read_text(encoding="utf-8")).substitute(
        name=escape(campaign.file.campaign),
        about=CODE.sub(r"<code>\1</code>", escape(campaign.file.about)),
        verdict=escape(verdict(campaign)),
        **{"class": "bad" if campaign.violated else "good"},
        maps="\n".join(_map(train, cells) for train, cells in by_train(campaign.cells).items()),
        runs=campaign.runs,
        seed=campaign.seed,
        code=campaign.as_dict()["code"],
        table=_table(campaign),
        innocents=_innocents(campaign),
        failed=_failed(campaign),
    )
    (folder / "index.html").write_text(page, encoding="utf-8")
    (folder / "maps.md").write_text(as_markdown(campaign.cells), encoding="utf-8")
    (folder / "results.json").write_text(json.dumps(campaign.as_dict(), indent=1) + "\n", encoding="utf-8")


def _map(train: str, cells: Sequence[dict[str, Any]]) -> str:
    """A train's map: faults by units; where two units lie, the first by the second."""
    marks, rows, columns = grid(cells)
    lines = ['<tr><td style="visibility:hidden"></td>' + "".join(f"<th>{escape(column)}</th>" for column in columns) + "</tr>"]
    for row in rows:
        inside = "".join(_cell(marks.get((row, column))) for column in columns)
        lines.append(f'<tr><th scope="row">{escape(row)}</th>{inside}</tr>')
    return f'<h2>{escape(train)}</h2><div class="wide"><table class="map">{"".join(lines)}</table></div>'


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
