"""Prometheus's alert rules: one for each event that asks for somebody, and one for each row of a table of metrics."""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import yaml

from milepost_schemas import EVENT_CODES, EventCode

# an event stays an alert for this long, which is several scrapes
EVENT_WINDOW = "5m"
HEAD = (
    "# Made by `milepost events --prometheus` from the table of events and the table of metric alerts; a test compares them.\n"
)


class MetricAlert(NamedTuple):
    """An alert on what the state and the processes show, with how long it must last, and what to do."""

    name: str
    expr: str
    lasts: str
    severity: str
    meaning: str
    action: str
    about: str = "train"


METRIC_ALERTS: tuple[MetricAlert, ...] = (
    MetricAlert(
        "FeedDown",
        'up{job="milepost"} == 0',
        "15s",
        "error",
        "the web server with the metrics does not answer",
        "start `milepost feed`",
        about="instance",
    ),
    MetricAlert(
        "NoState",
        # against the time of the scrape: between scrapes the clock goes on
        "timestamp(milepost_state_received_timestamp_seconds) - milepost_state_received_timestamp_seconds > 2",
        "0s",
        "error",
        "no state has come for two seconds",
        "do not use the train's position; see whether its fuser and the router run",
    ),
    MetricAlert(
        "Lost",
        'milepost_status{milepost_status="lost"} == 1',
        "0s",
        "error",
        "the position is too uncertain to be used",
        "do not use the train's position; the excluded units say why",
    ),
    MetricAlert(
        "NotNormal",
        'milepost_status{milepost_status="normal"} == 0',
        "1m",
        "warning",
        "the train has not been normal for a minute",
        "see which units are excluded or doubted, and why",
    ),
    MetricAlert(
        "StatesMissing",
        "increase(milepost_states_missing_total[1m]) > 0",
        "0s",
        "warning",
        "states were not published, or got lost on the way",
        "see the fuser's restarts and the load of router and network",
    ),
    MetricAlert(
        "StatesLate",
        "histogram_quantile(0.99, sum by (train, le) (rate(milepost_state_latency_seconds_bucket[1m]))) > 0.03",
        "1m",
        "warning",
        "one state in a hundred is published more than 30 ms after its epoch",
        "see the load of the fuser's machine, and which units are late",
    ),
    MetricAlert(
        "StreamSlow",
        "milepost_process_sent_hertz < 0.8 * milepost_process_expected_hertz",
        "10s",
        "warning",
        "a process sends a stream more slowly than the train file says",
        "see the load of its process and its device",
    ),
    MetricAlert(
        "ProcessRestarted",
        "increase(milepost_process_restarts_total[5m]) > 0",
        "0s",
        "warning",
        "a process was started again",
        "read its log from before the restart",
    ),
)


def alert_rules() -> str:
    """The file of alert rules, as Prometheus takes it."""
    groups = [
        {"name": "milepost-metrics", "rules": [_of_metric(row) for row in METRIC_ALERTS]},
        {"name": "milepost-events", "rules": [_of_event(row) for row in EVENT_CODES if row.action]},
    ]
    return HEAD + str(yaml.safe_dump({"groups": groups}, sort_keys=False, width=120, allow_unicode=True))


def alert_name(code: str) -> str:
    """`MilepostUnitSilent` for `unit_silent`."""
    return "Milepost" + "".join(word.capitalize() for word in re.findall(r"[a-z]+", code))


def _of_metric(row: MetricAlert) -> dict[str, Any]:
    return _rule(
        f"Milepost{row.name}", row.expr, row.lasts, row.severity, f"{{{{ $labels.{row.about} }}}}: {row.meaning}", row.action
    )


def _of_event(row: EventCode) -> dict[str, Any]:
    expr = f'increase(milepost_events_total{{code="{row.code}"}}[{EVENT_WINDOW}]) > 0'
    return _rule(alert_name(row.code), expr, "0s", row.severity, f"{{{{ $labels.train }}}}: {row.meaning}", row.action)


def _rule(name: str, expr: str, lasts: str, severity: str, summary: str, action: str) -> dict[str, Any]:
    return {
        "alert": name,
        "expr": expr,
        "for": lasts,
        "labels": {"severity": severity},
        "annotations": {"summary": summary, "description": action},
    }
