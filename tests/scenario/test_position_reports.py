"""The position reports of a whole train hold the truth: decoded as a radio block centre would, from the bits alone."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from milepost.config.etcs_file import balise_groups
from milepost.config.shipped_files import find_file
from milepost.config.train import load_train
from milepost.feeds.position_report import unpacked
from milepost.offline.run import simulate
from milepost_schemas import PositionReport

pytestmark = pytest.mark.slow
TRAIN = load_train(find_file(Path("regional"), "trains"))
PLACES = {group.nid_lrbg: group.position_m for group in balise_groups(TRAIN.line).values()}
SCALES_M = (0.1, 1.0, 10.0)


@pytest.fixture(scope="module")
def run() -> tuple[list[PositionReport], dict[int, Any]]:
    """The reports of 110 s, past two balise groups and to a stop, and the truth by time."""
    reports: list[PositionReport] = []
    truths: dict[int, Any] = {}

    def tap(output: Any, _: int) -> None:
        if output.stream == "position_report":
            reports.append(output.message)
        elif output.stream == "truth":
            truths[output.message.measured_at_ns] = output.message

    simulate(TRAIN, 110.0, tap)
    return reports, truths


def test_the_front_end_is_between_the_safe_ends_that_the_bits_say(run) -> None:
    reports, truths = run
    known = 0
    for report in reports:
        packet = unpacked(bytes.fromhex(report.packet_hex))
        if packet["nid_lrbg"] not in PLACES:
            assert packet["nid_lrbg"] == 2**24 - 1
            continue
        step_m = SCALES_M[packet["q_scale"]]
        # the train faces higher chainage, and so do all groups
        estimate_m = PLACES[packet["nid_lrbg"]] + (1 if packet["q_dlrbg"] == 1 else -1) * packet["d_lrbg"] * step_m
        front_m = truths[report.measured_at_ns].position_m + TRAIN.file.etcs.front_m
        assert estimate_m - packet["l_doubtover"] * step_m <= front_m <= estimate_m + packet["l_doubtunder"] * step_m
        known += 1
    assert known > 80


def test_reports_come_each_second_and_at_every_balise_group_and_stop(run) -> None:
    reports, _ = run
    gaps_s = [(b.measured_at_ns - a.measured_at_ns) * 1e-9 for a, b in pairwise(reports)]
    assert max(gaps_s) <= TRAIN.file.etcs.every_s + 1e-6
    assert reports[0].trigger == "first"
    passed = [report.nid_lrbg & 0x3FFF for report in reports if report.trigger == "balise_group"]
    assert passed == [1001, 1002]
    assert "standstill_reached" in {report.trigger for report in reports}
