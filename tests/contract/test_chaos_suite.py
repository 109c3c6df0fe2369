"""The chaos suite's tables agree with the train, and its document with the test that is run."""

from __future__ import annotations

from pathlib import Path

from milepost.chaos.matrix import planned
from milepost.chaos.threats import THREATS
from milepost.config.roles import processes
from milepost.config.train import load_train

ROOT = Path(__file__).resolve().parents[2]
FULL = ROOT / "deploy/trains/full.yaml"


def test_the_test_in_the_document_is_the_one_that_is_run() -> None:
    written = (ROOT / "docs/chaos.md").read_text(encoding="utf-8").partition("```python\n")[2].partition("```")[0]
    run = (ROOT / "tests/chaos/test_own_test.py").read_text(encoding="utf-8")
    head, *body = written.splitlines()
    assert head.removesuffix("(stack):") in run
    assert "\n".join(body) in run
    assert len(written.splitlines()) <= 10


def test_every_process_of_the_train_is_killed_stopped_and_replaced_by_a_cell_of_its_own() -> None:
    names = [cell.name for cell in planned(FULL, ())]
    assert len(set(names)) == len(names)
    for process in processes(load_train(FULL), live=True):
        if process.role != "fuser":
            assert {f"{process.name} {how}" for how in ("killed", "stopped 2 s", "replaced")} <= set(names)


def test_there_are_seven_threats_and_each_attacks_every_stream_of_the_table() -> None:
    assert len(THREATS) == 7
    names = [cell.name for cell in planned(FULL, ["reading/*", "estimate/*"])]
    assert len(names) == 4 * len(THREATS)
