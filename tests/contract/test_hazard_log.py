"""docs/hazards.md is traced to tests that exist."""

from __future__ import annotations

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
LOG = (ROOT / "docs" / "hazards.md").read_text(encoding="utf-8")
# the feared events that railway people trace
FEARED = (
    "speed underestimated",
    "wrong direction",
    "wrong orientation",
    "wrong map reference",
    "wrong reference balise",
    "the interval excludes the truth",
    "wrong acceleration bound",
    "wrong travelled distance",
)
THREATS = ("repetition", "deletion", "insertion", "resequencing", "corruption", "delay", "masquerade")
NAMED = sorted(set(re.findall(r"`(test_\w+)`", LOG)))
TESTS = {
    node.name
    for path in (ROOT / "tests").rglob("test_*.py")
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
    if isinstance(node, ast.FunctionDef)
}


@pytest.mark.parametrize("name", NAMED)
def test_a_named_test_exists(name: str) -> None:
    assert name in TESTS


@pytest.mark.parametrize("words", [*FEARED, *THREATS])
def test_every_feared_event_and_threat_has_a_row_with_tests(words: str) -> None:
    rows = [line for line in LOG.splitlines() if line.startswith("|") and words in (cell.strip() for cell in line.split("|"))]
    assert len(rows) == 1
    assert re.search(r"`test_\w+`", rows[0])


def test_it_says_that_nothing_is_certified() -> None:
    for name in ("docs/hazards.md", "SECURITY.md", "README.md"):
        assert "is not certified" in (ROOT / name).read_text(encoding="utf-8"), name
