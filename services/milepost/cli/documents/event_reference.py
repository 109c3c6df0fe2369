"""docs/reference-events.md: every event with its severity, meaning, and what to do about it."""

from __future__ import annotations

from milepost_schemas import EVENT_CODES

from .config_reference import cells

HEAD = """\
# Every event

Made by `milepost schema` from the table of events; `milepost events` prints it, `milepost events --json` as JSON,
`milepost events --prometheus` as alert rules. An event is a [message](reference-messages.md#event-1) on the key `event`: its
`code` is for programs, its `text` for people.

| code | severity | meaning | what to do |
| --- | --- | --- | --- |
"""


def event_reference() -> str:
    """The whole document."""
    return HEAD + "".join(cells(f"`{row.code}`", row.severity, row.meaning, row.action) for row in EVENT_CODES)
