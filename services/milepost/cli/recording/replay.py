"""`milepost replay`: a recording on the bus again."""

from __future__ import annotations

import sys
from pathlib import Path

from milepost.recorder.library import need_mcap
from milepost.runtime.zenoh_config import Connection

from ..showing.progress import progress_bar


def run_replay(
    recording: Path, speed: float, connection: Connection, since: str | None = None, until: str | None = None
) -> int:
    """Send what was recorded, or a part of it; 1 if there is nothing in it, its train runs, or no router is there.

    Raises ConfigError.
    """
    need_mcap("replay")
    from milepost.recorder.reading import recordings_in
    from milepost.recorder.window import outside, window_of
    from milepost.runtime.recording.replay import TrainIsRunningError, replay

    files = recordings_in(recording)
    window = window_of(files, since, until)
    with progress_bar("replaying", sum(file.stat().st_size for file in files)) as show:
        try:
            done = replay(files, speed, connection, show, window)
        except TrainIsRunningError as error:
            print(f"milepost: {error}", file=sys.stderr)
            return 1
    for flaw in done.flaws:
        print(f"milepost: {flaw}", file=sys.stderr)
    late = f"; the latest one {done.latest_s * 1e3:.0f} ms late" if done.latest_s >= 0.01 else ""
    print(f"{done.sent} messages of {done.span_s:.1f} s sent{late}; {done.left_out} left out", file=sys.stderr)
    if not done.sent + done.left_out and (said := outside(files, window)):
        print(f"milepost: {said}", file=sys.stderr)
    return 0 if done.sent else 1
