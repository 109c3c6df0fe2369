"""Two clocks in one log: that of whoever wrote it, and the receiver's own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from .columns import Column
from .log_file import LogFile

# a log that is written later than this after the fix is not written as fixes come
LATEST_S = 1.0
LEAST_ROWS = 10


def on_the_clock_of(log: LogFile, own: Column, common: Column) -> tuple[Column, str] | None:
    """The receiver's `own` time column, shifted to the `common` clock, and a sentence on that; None where they do not agree.

    Stamps of arrival come late by what it took; the least delay that was seen stands for none.
    """
    if own.time is None or common.time is None or own.date or common.date:
        return None
    late = []
    for _, (there, here) in log.rows([own.name, common.name]):
        try:
            late.append(common.time.seconds(here) - own.time.seconds(there))
        except ValueError:
            continue
    if len(late) < LEAST_ROWS:
        return None
    least_s, most_s = (float(each) for each in np.percentile(late, [0.0, 99.0]))
    if not math.isfinite(most_s) or most_s - least_s > LATEST_S:
        return None
    told = (
        f"fixes are timed by the receiver's own clock, {own.name}: {common.name} is up to {most_s - least_s:.2f} s late. "
        f"Nothing tells whether {own.name} is late too: see `zero_at` of unit gnss"
    )
    return replace(own, ahead_s=least_s, why=f"{own.why}, on the clock of {common.name}"), told
