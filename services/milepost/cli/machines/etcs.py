"""`milepost etcs`: the position reports of ERTMS/ETCS that trains on a router send."""

from __future__ import annotations

import queue

from milepost.feeds.position_report_text import in_words
from milepost.runtime.inbox.taking import take
from milepost.runtime.listening import listening
from milepost.runtime.logs.records import say
from milepost.runtime.zenoh_config import Connection
from milepost_schemas import Message, PositionReport

from ..showing.until_interrupted import until_interrupted

# reports come at least this often where any train sends them
SILENT_S = 5.0
HINT = "no train sends position reports; the section `etcs` of a train file makes it send them"


def run_etcs(connect: Connection, as_json: bool, count: int | None) -> int:
    """Print each report as it comes, until interrupted or `count` have come; 1 where there is no router."""
    reports: queue.SimpleQueue[PositionReport] = queue.SimpleQueue()

    def receive(_: str, message: Message, __: int) -> None:
        if isinstance(message, PositionReport):
            reports.put(message)

    def show() -> None:
        with listening(connect, ["position_report"], "*", receive):
            _print(reports, as_json, count)

    return until_interrupted(show)


def _print(reports: queue.SimpleQueue[PositionReport], as_json: bool, count: int | None) -> None:
    printed, hinted = 0, False
    while count is None or printed < count:
        try:
            report = take(reports, SILENT_S)
        except queue.Empty:
            if not (printed or hinted):
                say(HINT)
                hinted = True
            continue
        print(report.model_dump_json() if as_json else in_words(report), flush=True)
        printed += 1
