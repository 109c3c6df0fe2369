"""What `milepost up` says, and the report that it leaves."""

from __future__ import annotations

import contextlib
import json
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

from milepost.runtime.logs.records import say


@contextlib.contextmanager
def scratch(report: Path | None) -> Iterator[Path]:
    """A folder for what only a report needs."""
    if report is None:
        yield Path()
        return
    report.unlink(missing_ok=True)
    with tempfile.TemporaryDirectory(prefix="milepost-") as folder:
        yield Path(folder)


@contextlib.contextmanager
def telling(to_table: bool) -> Iterator[tuple[Callable[[str], None], int | None]]:
    """A function that shows a sentence; where the table does it, also the end of the pipe where it hears them."""
    if not to_table:
        yield say, None
        return
    heard, tells = os.pipe()
    os.set_blocking(tells, False)

    def tell(sentence: str) -> None:
        with contextlib.suppress(BlockingIOError):  # the table hangs; nothing here may
            os.write(tells, f"{sentence}\n".encode())

    try:
        yield tell, heard
    finally:
        os.close(heard)
        os.close(tells)


def completed(report: Path, began_ns: int, memory_mib: float) -> bool:
    """Add to the observer's report what only this process knows; False if there is none."""
    if not report.is_file():
        return False
    found = json.loads(report.read_text(encoding="utf-8"))
    for each in found.get("trains", {"": found}).values():
        first_ns = each.get("first_at_ns")
        each["first_state_s"] = None if first_ns is None else (first_ns - began_ns) * 1e-9
    found["memory_pss_mib"] = memory_mib or None
    report.write_text(json.dumps(found, indent=2) + "\n", encoding="utf-8")
    return True
