"""`milepost events`: the table of events."""

from __future__ import annotations

import json

from milepost_schemas import EVENT_CODES


def run_events(as_json: bool) -> None:
    """Show every code with its severity and meaning."""
    if as_json:
        print(json.dumps([row._asdict() for row in EVENT_CODES]))
        return
    widest = max(len(row.code) for row in EVENT_CODES)
    for row in EVENT_CODES:
        print(f"{row.code:{widest}}  {row.severity:7}  {row.meaning}")
