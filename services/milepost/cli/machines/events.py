"""`milepost events`: the table of events."""

from __future__ import annotations

import json

from milepost_schemas import EVENT_CODES


def run_events(as_json: bool, as_rules: bool = False) -> None:
    """Show every code with its severity and meaning, in JSON also what to do; or Prometheus's alert rules."""
    if as_rules:
        from milepost.feeds.alerts import alert_rules

        print(alert_rules(), end="")
        return
    if as_json:
        print(json.dumps([row._asdict() for row in EVENT_CODES]))
        return
    widest = max(len(row.code) for row in EVENT_CODES)
    for row in EVENT_CODES:
        print(f"{row.code:{widest}}  {row.severity:7}  {row.meaning}")
