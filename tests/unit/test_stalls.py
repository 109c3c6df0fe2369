"""The stall sentinel: what it notes of a processor that stands still, and what is made of its notes."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from milepost.checks.stalls import joined, read_stalls, stalled_ns

MS = 1_000_000


def line(end_ms: float, stall_ms: float) -> str:
    return json.dumps({"at_ns": round(end_ms * MS), "stall_ms": stall_ms})


def test_stalls_of_two_processors_at_once_count_once(tmp_path: Path) -> None:
    notes = tmp_path / "stalls.jsonl"
    # 20 to 50 and 30 to 90 overlap; 100 to 120 stands alone; the last line is still being written
    notes.write_text("\n".join([line(90, 60.0), line(50, 30.0), line(120, 20.0), '{"at_ns": 17']), encoding="utf-8")
    stalls = read_stalls(notes)
    assert stalls == [(20 * MS, 90 * MS), (100 * MS, 120 * MS)]
    assert stalled_ns(stalls, 40 * MS, 110 * MS) == 60 * MS
    assert stalled_ns(stalls, 90 * MS, 100 * MS) == 0


def test_a_stall_within_another_adds_nothing() -> None:
    assert joined([(0, 100), (10, 20), (100, 110)]) == [(0, 110)]


def test_without_notes_there_was_no_stall(tmp_path: Path) -> None:
    assert read_stalls(tmp_path / "none.jsonl") == []


def may_go_first() -> bool:
    try:
        before = os.sched_getscheduler(0)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(1))
        os.sched_setscheduler(0, before, os.sched_param(0))
    except (AttributeError, PermissionError):
        return False
    return True


HOG = """
import os, sys, time
os.sched_setaffinity(0, {int(sys.argv[1])})
if sys.argv[2] == "first":
    os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(2))
end = time.monotonic() + float(sys.argv[3])
while time.monotonic() < end:
    pass
"""


@pytest.mark.skipif(not may_go_first(), reason="needs the right to real-time scheduling")
@pytest.mark.parametrize(("who", "noted"), [("first", True), ("ordinary", False)])
def test_a_processor_that_stands_still_is_noted_and_one_that_is_busy_is_not(tmp_path: Path, who: str, noted: bool) -> None:
    """A process that goes before the sentinel on one processor is to the others what a host is that takes it away."""
    notes = tmp_path / "stalls.jsonl"
    sentinel = subprocess.Popen([sys.executable, "-m", "milepost", "sentinel", "--stalls", str(notes)])
    try:
        while not notes.is_file():
            time.sleep(0.01)
            assert sentinel.poll() is None
        cpu = max(os.sched_getaffinity(0))
        begun = time.time_ns()
        subprocess.run([sys.executable, "-c", HOG, str(cpu), who, "0.3"], check=True)
        ended = time.time_ns()
    finally:
        sentinel.send_signal(signal.SIGTERM)
        assert sentinel.wait(5.0) == 0
    stalled_s = stalled_ns(read_stalls(notes), begun, ended) * 1e-9
    assert (stalled_s > 0.2) == noted
