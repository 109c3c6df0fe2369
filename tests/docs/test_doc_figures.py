"""Figures that pages state of the default train are those of the code."""

from __future__ import annotations

import re

import numpy as np
from doc_pages import DOCS, ROOT

from milepost.config.fusion_settings import doubts
from milepost.config.train import load_train
from milepost.fusion.hypotheses import NOBODY, Rows

DOUBTS = doubts(load_train(ROOT / "deploy/trains/full.yaml"))
ROWS = Rows(DOUBTS, NOBODY)


def text(name: str) -> str:
    return (DOCS / "explanation" / f"{name}.md").read_text(encoding="utf-8")


def test_the_numbers_of_units_and_rows_and_the_limit_are_those_of_the_default_train() -> None:
    found = re.search(r"has (\d+) units and a bank of (\d+) rows", text("hypotheses"))
    assert found is not None
    assert [int(number) for number in found.groups()] == [len(DOUBTS.suspects), len(ROWS.sets)]
    assert f"For the default train k is {DOUBTS.threshold:.1f}." in text("hypotheses")


def test_the_table_of_reaches_is_that_of_the_default_train() -> None:
    published, reaches = ROWS.intervals(np.ones(len(ROWS.sets), dtype=bool), 0)
    assert f"(n = {int(published.sum())})" in text("interval")
    stated = {(float(p), float(k)) for p, k in re.findall(r"\| ([\d.e-]+) \| ([\d.]+) \|", text("interval"))}
    assert stated == {(p, round(k, 2)) for p, k in zip(ROWS.chances[published].tolist(), reaches.tolist(), strict=True)}
