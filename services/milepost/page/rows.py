"""What a browser shows, as rows of fields, and what of it is different from what it was sent before."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

Value = str | float | None
Fields = dict[str, Value]
# rows by their names
Rows = dict[str, Fields]


class Change(NamedTuple):
    """Fields that are new or different, by row, and rows that are gone."""

    set: Rows
    gone: list[str]


class Sent:
    """What one browser was sent."""

    def __init__(self) -> None:
        self._rows: Mapping[str, Fields] = {}

    def change(self, rows: Rows) -> Change:
        """What to send so that it shows these rows."""
        before, self._rows = self._rows, rows
        different = {}
        for name, fields in rows.items():
            old = before.get(name)
            if old is None:
                different[name] = fields
            elif changed := {key: value for key, value in fields.items() if old.get(key) != value or key not in old}:
                different[name] = changed
        return Change(different, [name for name in before if name not in rows])
