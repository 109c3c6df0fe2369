"""The pages do what they say: each is followed in an empty folder."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml
from doc_console import Reader, Step, alike, matches, steps
from doc_pages import DOCS, PAGES, ROOT, Page

pytestmark = pytest.mark.long

# in the order of the site's menu: a page of the tutorial uses the files of those before it
TUTORIAL = [DOCS / f"tutorial/{name}.md" for name in ("first-run", "line", "sensor", "recording", "chaos-test")]
STARTS = ("milepost up", "pytest")


def followed(page: Page) -> list[Step]:
    return [step for block in page.blocks if block.language == "console" for step in steps(block)]


def is_live(page: Page) -> bool:
    return any(step.command.startswith(STARTS) for step in followed(page))


def cases() -> Iterator[object]:
    for page in PAGES:
        if followed(page):
            yield pytest.param(page, id=page.name, marks=pytest.mark.system if is_live(page) else pytest.mark.slow)


@pytest.fixture
def reader(tmp_path: Path) -> Iterator[Reader]:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    somebody = Reader(tmp_path, port)
    codes = None
    try:
        yield somebody
    finally:
        codes = list(somebody.leave())
    assert not any(codes)


@pytest.mark.parametrize("page", list(cases()))
def test_a_page_does_what_it_says(page: Page, reader: Reader) -> None:
    """GIVEN the files of the page, and of the tutorial before it, WHEN its commands are run, THEN they print what it shows."""
    before = TUTORIAL[: TUTORIAL.index(page.path)] if page.path in TUTORIAL else []
    for each in (*map(Page, before), page):
        reader.write(each.files)
    for step in followed(page):
        reader.follow(step, is_live(page))


def test_the_tutorial_is_in_the_order_of_the_menu() -> None:
    menu = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"]
    (listed,) = [entry["Tutorial"] for entry in menu if "Tutorial" in entry]
    assert [DOCS / name for name in listed] == TUTORIAL


def test_a_file_that_is_written_is_used_by_a_page_that_is_followed() -> None:
    for page in PAGES:
        assert not page.files or followed(page), page.name


def test_numbers_of_live_runs_may_differ_and_words_may_not() -> None:
    assert alike("a: 1.50 m", "a:  1.51 m", live=False)
    assert not alike("a: 1.50 m", "a: 1.60 m", live=False)
    assert alike("a: 1.50 m", "a: -160 m", live=True)
    assert not alike("a: normal", "a: lost", live=True)
    assert matches(["...", "b", "..."], ["a", "b"], live=False)
    assert not matches(["a"], ["a", "b"], live=False)
