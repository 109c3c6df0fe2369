"""The report: one page with all judged claims, the figures and pictures of every scenario, and the same as JSON."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from string import Template
from typing import Any

from milepost.checks.table import HEADINGS as CHECK_HEADINGS
from milepost.checks.table import check_rows

from .campaign import Evaluated, Skipped, as_fields
from .claims import JudgedClaim
from .plotting import Spans, draw_diameter, draw_errors, draw_shares
from .scenario_run import Traces
from .tables import HEADINGS, flat, row_cells, with_worst

PAGE = Path(__file__).with_name("report.html")
# more lines than this in one picture cannot be told apart
MOST_LINES = 6
KIND = {True: "met", False: "missed", None: ""}
CODE = re.compile(r"`([^`]+)`")
PICTURE = '<figure><img src="{file}" alt="{text}"><figcaption>{text}</figcaption></figure>'


def write_report(folder: Path, done: Sequence[Evaluated], skipped: Sequence[Skipped]) -> None:
    """Write `index.html`, `results.json` and the pictures into a folder, which is made if it does not exist."""
    folder.mkdir(parents=True, exist_ok=True)
    sections = [_section(each, _pictures(folder, each)) for each in done]
    rows = sorted((row for each in done for row in each.rows), key=lambda row: row.source)
    page = Template(PAGE.read_text(encoding="utf-8")).substitute(
        verdict=escape(_verdict(rows)),
        claims=_claims(rows),
        skipped="".join(f"<p>Skipped: {escape(each.scenario)}; {escape(each.reason)}</p>" for each in skipped),
        contents=" · ".join(
            f'<a href="#{escape(each.scenario.scenario)}">{escape(each.scenario.scenario)}</a>' for each in done
        ),
        sections="\n".join(sections),
    )
    (folder / "index.html").write_text(page, encoding="utf-8")
    (folder / "results.json").write_text(json.dumps(as_fields(done, skipped), indent=1) + "\n", encoding="utf-8")


def _verdict(rows: Sequence[JudgedClaim]) -> str:
    judged = [row.met for row in rows if row.met is not None]
    return f"{sum(judged)} of {len(judged)} targets met."


def _claims(rows: Sequence[JudgedClaim]) -> str:
    lines = [_line(HEADINGS, "th")]
    for row in rows:
        lines.append(_line(row_cells(row), "td", KIND[row.met]))
        if row.met is False:
            why = escape(row.why or "no reason in the scenario file")
            lines.append(f'<tr class="why"><td></td><td colspan="{len(HEADINGS) - 1}">Not met: {why}</td></tr>')
    return "\n".join(lines)


def _line(cells: Sequence[str], tag: str, kind: str = "") -> str:
    inside = "".join(f"<{tag}>{escape(cell)}</{tag}>" for cell in cells)
    return f'<tr class="{kind}">{inside}</tr>' if kind else f"<tr>{inside}</tr>"


def _section(each: Evaluated, pictures: Sequence[tuple[str, str]]) -> str:
    figures, scenario = each.figures, each.scenario
    parts = [f'<section id="{escape(scenario.scenario)}"><h2>{escape(scenario.scenario)}</h2>']
    if scenario.about:
        parts.append("<p>" + CODE.sub(r"<code>\1</code>", escape(scenario.about)) + "</p>")
    parts.append(
        f"<p>{scenario.duration_s:g} s on {figures['runs']} seed(s) from {figures['seed']}; the pictures are of the first.</p>"
    )
    parts.append(_figures("", figures))
    parts += [_figures(name, variant) for name, variant in figures.get("variants", {}).items()]
    parts += [PICTURE.format(file=file, text=escape(text)) for text, file in pictures]
    return "\n".join([*parts, "</section>"])


def _figures(name: str, condition: Mapping[str, Any]) -> str:
    """The table of one condition: a row for each figure, a column for each estimator; medians, the worst in brackets."""
    estimators = condition["estimators"]
    medians = [flat({key: value for key, value in figures.items() if key != "worst"}) for figures in estimators.values()]
    worst = [flat(figures["worst"]) for figures in estimators.values()]
    lines = [_line(["", *estimators], "th")]
    for key in dict.fromkeys(key for figures in medians for key in figures):
        cells = [with_worst(m[key], w[key]) if key in m else "-" for m, w in zip(medians, worst, strict=True)]
        lines.append(_line([key, *cells], "td"))
    alone = [f"{key}: {value:.4g}" for key, value in condition.items() if key.startswith(("fused_", "withheld_"))]
    alone += [condition["not_scored"]] if "not_scored" in condition else []
    heading = f"<h3>{escape(name)}</h3>" if name else ""
    after = f"<p>{escape(', '.join(alone))}</p>" if alone else ""
    after += "".join(_checks(each, found) for each, found in condition.get("checks", {}).items())
    return f'{heading}<div class="wide"><table class="figures">{"".join(lines)}</table></div>{after}'


def _checks(estimator: str, found: Mapping[str, Any]) -> str:
    rows = [_line(CHECK_HEADINGS, "th"), *(_line(cells, "td") for cells in check_rows(found))]
    title = f"<h3>Checks of {escape(estimator)}, the worst seed of each figure</h3>"
    return f'{title}<div class="wide"><table class="figures">{"".join(rows)}</table></div>'


def _pictures(folder: Path, each: Evaluated) -> list[tuple[str, str]]:
    """Draw the pictures of a scenario; returns (text, file) of each."""
    out: list[tuple[str, str]] = []
    for case in each.plan.cases:
        traces = (each.traces or {}).get(case.name)
        if not traces:
            continue
        title = each.scenario.scenario + (f", {case.name}" if case.name else "")
        stem = each.plan.path.stem + (f".{case.name}" if case.name else "")
        ours = next((claim.ours for claim in each.scenario.claims if claim.ours in traces), next(iter(traces)))
        chosen = _chosen(each, traces)
        if all(trace.truth is not None for trace in chosen.values()):
            draw_errors(folder / f"{stem}.errors.png", title, chosen, ours, _shaded(each, case.name))
            out.append((f"{title}: errors against the truth, and the published interval", f"{stem}.errors.png"))
        shared = {name: trace for name, trace in chosen.items() if len(trace.shares) > 1}
        if shared:
            draw_shares(folder / f"{stem}.shares.png", title, shared)
            out.append((f"{title}: shares of the units", f"{stem}.shares.png"))
        wheels = [u for u in case.train.fused_units if case.train.sensors[u].kind == "odometer"]
        scaled = {name: t for name, t in chosen.items() if any(f"{unit}.scale" in t.private for unit in wheels)}
        if wheels and scaled:
            draw_diameter(folder / f"{stem}.diameter.png", title, scaled, case.train, wheels)
            out.append((f"{title}: wheel diameter, with 2 σ", f"{stem}.diameter.png"))
    return out


def _chosen(each: Evaluated, traces: Traces) -> Traces:
    """The traces that claims name, or all of them where no claim names one; at most MOST_LINES."""
    named = {name for claim in each.scenario.claims for name in (claim.ours, claim.method, claim.optimum, claim.over)}
    chosen = {name: trace for name, trace in traces.items() if name in named} or traces
    return dict(list(chosen.items())[:MOST_LINES])


def _shaded(each: Evaluated, case: str) -> Spans:
    windows = dict(each.scenario.windows)
    if case:
        windows |= each.scenario.variants[case].windows
    spans = [(name, a, b) for name, window in windows.items() if window != "creep" for a, b in window]
    return [(name, a, b) for name, a, b in spans if b - a < each.scenario.duration_s]
