"""What is told of progress where nobody sits at a terminal."""

from __future__ import annotations

import io

import pytest

from milepost.cli.showing.progress import ProgressLines, progress_bar


def test_a_log_gets_a_line_a_minute() -> None:
    """GIVEN 200 units of work, one every two seconds THEN it says each minute how much is done and how long the rest takes."""
    now, out = [0.0], io.StringIO()
    tell = ProgressLines("evaluating", 200.0, out, lambda: now[0])
    for done in range(1, 201):
        now[0] = 2.0 * done
        tell(done)
    assert out.getvalue().splitlines() == [
        "evaluating: 15 %, about 6 min left",
        "evaluating: 30 %, about 5 min left",
        "evaluating: 45 %, about 4 min left",
        "evaluating: 60 %, about 3 min left",
        "evaluating: 75 %, about 2 min left",
        "evaluating: 90 %, about 1 min left",
    ]


def test_nothing_is_told_of_what_is_short_or_has_not_begun() -> None:
    now, out = [0.0], io.StringIO()
    tell = ProgressLines("evaluating", 10.0, out, lambda: now[0])
    tell(5.0)
    now[0] = 100.0
    tell(0.0)
    assert out.getvalue() == ""


def test_what_is_no_terminal_gets_lines(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar("evaluating", 1.0) as show:
        assert isinstance(show, ProgressLines)
        show(1.0)
    assert capsys.readouterr().err == ""
