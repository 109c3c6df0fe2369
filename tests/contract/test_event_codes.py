"""The table of events has every one that the processes can send, and README explains each."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from milepost_schemas import EVENT_CODES, EventCode

ROOT = Path(__file__).parents[2]
CODE = re.compile(r'"(info|warning|error)",\s*"([a-z]+_[a-z_]+)"')
SOURCES = [file.read_text(encoding="utf-8") for folder in ("services", "schemas") for file in (ROOT / folder).rglob("*.py")]
SENT = sorted({(code, severity) for source in SOURCES for severity, code in CODE.findall(source)})
# composed of two words where they are sent
COMPOSED = ("unit_absent", "unit_silent", "unit_late", "gnss_frozen", "gnss_ambiguous", "gnss_off_line", "refused_REASON")
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_codes_are_found() -> None:
    assert {("unit_excluded", "warning"), ("balises_missed", "error"), ("wheel_diameter", "info")} <= set(SENT)


@pytest.mark.parametrize(("code", "severity"), SENT)
def test_the_table_has_what_is_sent_and_readme_explains_it(code: str, severity: str) -> None:
    assert (code, severity) in {(row.code, row.severity) for row in EVENT_CODES}
    assert f"`{code}`" in README


@pytest.mark.parametrize("row", EVENT_CODES, ids=lambda row: row.code)
def test_what_is_in_the_table_is_sent(row: EventCode) -> None:
    outside = [source for source in SOURCES if "EVENT_CODES: tuple" not in source]
    assert row.code in COMPOSED or any(f'"{row.code}"' in source for source in outside)


def test_no_code_is_there_twice() -> None:
    assert len({row.code for row in EVENT_CODES}) == len(EVENT_CODES)
