"""Links of the documentation lead to files and headings that are there, and pictures are small."""

from __future__ import annotations

import pytest
from doc_pages import DOCS, EVERYWHERE, PAGES, ROOT, Page, slug

LARGEST_PICTURE = 150_000
# a reader finds the answer in the first screen
LONGEST_PAGE = 130


@pytest.mark.parametrize("page", EVERYWHERE, ids=lambda page: page.name)
def test_a_link_leads_to_a_file_and_a_heading_that_are_there(page: Page) -> None:
    for target in page.links:
        if target.startswith(("https://", "http://")):
            continue
        place, _, anchor = target.partition("#")
        found = (page.path.parent / place).resolve() if place else page.path
        assert found.is_file(), f"{page.name}: {target}"
        assert found.is_relative_to(ROOT), f"{page.name}: {target}"
        if anchor:
            assert anchor in Page(found).anchors, f"{page.name}: {target}"


def test_a_heading_is_named_in_links_without_its_punctuation() -> None:
    assert slug(" `units.NAME`: every kind of unit") == "unitsname-every-kind-of-unit"
    assert slug(" `world.motion.gnss_log`: Recording") == "worldmotiongnss_log-recording"


def test_links_are_found() -> None:
    """Without this, the test above could prove nothing."""
    assert sum(len(page.links) for page in EVERYWHERE) > 100


def test_every_page_can_be_reached_from_the_first_one() -> None:
    reached, left = set[str](), [DOCS / "index.md"]
    while left:
        path = left.pop()
        if path in reached or path.suffix != ".md":
            continue
        reached.add(path)
        left += [(path.parent / target.partition("#")[0]).resolve() for target in Page(path).links if "://" not in target]
    assert {page.path for page in PAGES} <= reached


@pytest.mark.parametrize("path", sorted((DOCS / "pictures").iterdir()), ids=lambda path: path.name)
def test_a_picture_is_shown_small_and_loads_nothing(path) -> None:
    shown = [page.name for page in EVERYWHERE if f"pictures/{path.name})" in page.path.read_text(encoding="utf-8")]
    assert shown
    content = path.read_bytes()
    assert len(content) < LARGEST_PICTURE
    assert b"@import" not in content
    assert b"url(http" not in content


@pytest.mark.parametrize("page", [page for page in PAGES if "reference-" not in page.name], ids=lambda page: page.name)
def test_a_page_is_short(page: Page) -> None:
    assert len(page.path.read_text(encoding="utf-8").splitlines()) <= LONGEST_PAGE
