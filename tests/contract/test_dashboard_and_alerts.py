"""Dashboard and alert rules ask for metrics that are exported, and the rules are those of the tables."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from itertools import combinations
from pathlib import Path
from typing import Any, get_args

import pytest
import yaml

from milepost.feeds.alerts import METRIC_ALERTS, alert_name, alert_rules
from milepost.feeds.metric_table import METRICS, Metric
from milepost_schemas import EVENT_CODES
from milepost_schemas.state import Status

ROOT = Path(__file__).parents[2]
ALERTS = ROOT / "deploy/prometheus/alerts.yaml"
RULES = [rule for group in yaml.safe_load(ALERTS.read_text(encoding="utf-8"))["groups"] for rule in group["rules"]]
DASHBOARD = json.loads((ROOT / "deploy/grafana/milepost.json").read_text(encoding="utf-8"))
SUFFIXES = {"counter": ("_total",), "info": ("_info",), "histogram": ("_bucket", "_sum", "_count")}


def exported() -> Iterator[tuple[str, Metric]]:
    """Every name that a scrape has, with its row."""
    for row in METRICS:
        for suffix in SUFFIXES.get(row.kind, ("",)):
            yield row.name + suffix, row


EXPORTED = dict(exported())


def labels_of(row: Metric) -> set[str]:
    more = {"stateset": {row.name}, "info": {"line", "line_hash"}, "histogram": {"le"}}
    return {*row.labels, *more.get(row.kind, set())}


def check(expr: str) -> int:
    """Every metric in an expression is exported, with the labels that it is asked for; returns their number."""
    found = re.findall(r"\b(milepost_\w+)(?:\{([^}]*)\})?", expr)
    for name, selector in found:
        assert name in EXPORTED, expr
        assert set(re.findall(r"(\w+)\s*(?:=~|!=|!~|=)", selector)) <= labels_of(EXPORTED[name]), expr
    for by in re.findall(r"by \(([^)]*)\)", expr):
        for name, _ in found:
            assert set(by.split(", ")) <= labels_of(EXPORTED[name]), expr
    return len(found)


def test_the_file_of_rules_is_made_of_the_tables() -> None:
    assert ALERTS.read_text(encoding="utf-8") == alert_rules(), "milepost events --prometheus > deploy/prometheus/alerts.yaml"


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule["alert"])
def test_a_rule_asks_for_what_is_exported_and_says_what_to_do(rule: dict[str, Any]) -> None:
    # `up` is Prometheus's own
    assert check(rule["expr"]) or rule["expr"].startswith("up{")
    assert rule["labels"]["severity"] in ("warning", "error")
    assert rule["annotations"]["summary"].startswith("{{ $labels.")
    assert len(rule["annotations"]["description"]) > 10
    codes = {row.code for row in EVENT_CODES}
    assert set(re.findall(r'code="(\w+)"', rule["expr"])) <= codes
    assert set(re.findall(r'milepost_status="(\w+)"', rule["expr"])) <= set(get_args(Status))


def test_every_error_and_only_what_asks_for_somebody_has_a_rule() -> None:
    names = [rule["alert"] for rule in RULES]
    assert len(set(names)) == len(names)
    assert names == [f"Milepost{row.name}" for row in METRIC_ALERTS] + [
        alert_name(row.code) for row in EVENT_CODES if row.action
    ]
    for row in EVENT_CODES:
        assert row.action or row.severity != "error", row.code
        assert not row.action or row.severity != "info", row.code


def test_the_guide_lists_every_metric_and_no_other() -> None:
    section = (ROOT / "docs/machines.md").read_text(encoding="utf-8").split("\n## Metrics\n")[1].split("\n## ")[0]
    rows = [line for line in section.splitlines() if line.startswith("| `milepost_")]
    listed = {name for row in rows for name in re.findall(r"`(milepost_\w+)`", row.split(" | ")[0])}
    ends = {"counter": "_total", "info": "_info"}
    assert listed == {row.name + ends.get(row.kind, "") for row in METRICS}
    for row in METRICS:
        (line,) = [line for line in rows if f"`{row.name}{ends.get(row.kind, '')}`" in line.split(" | ")[0]]
        for label in labels_of(row) - {"train"}:
            assert f"`{label}`" in line.split(" | ")[1], row.name


PANELS: list[dict[str, Any]] = DASHBOARD["panels"]


@pytest.mark.parametrize("panel", PANELS, ids=lambda panel: panel["title"])
def test_a_panel_asks_for_what_is_exported(panel: dict[str, Any]) -> None:
    for target in panel["targets"]:
        assert check(target["expr"]) >= 1
        rows = [EXPORTED[name] for name, _ in re.findall(r"\b(milepost_\w+)(\{)", target["expr"]) if name in EXPORTED]
        known = set().union(*(labels_of(row) for row in rows))
        assert set(re.findall(r"\{\{(\w+)\}\}", target["legendFormat"])) <= known


def test_panels_have_ids_of_their_own_and_do_not_overlap() -> None:
    assert len({panel["id"] for panel in PANELS}) == len(PANELS)
    cells = [
        {(x, y) for x in range(at["x"], at["x"] + at["w"]) for y in range(at["y"], at["y"] + at["h"])}
        for at in (panel["gridPos"] for panel in PANELS)
    ]
    assert all(x < 24 for cell in cells for x, _ in cell)
    assert not any(one & other for one, other in combinations(cells, 2))


def test_the_dashboard_shows_most_of_what_is_exported() -> None:
    text = json.dumps(DASHBOARD)
    shown = {row.name for row in METRICS if re.search(rf"{row.name}(_total|_bucket|_info)?\b", text)}
    assert len(shown) >= 0.7 * len(METRICS), sorted({row.name for row in METRICS} - shown)
