"""README names every event that the processes can send."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
CODE = re.compile(r'"(?:info|warning|error)",\s*"([a-z]+_[a-z_]+)"')
CODES = sorted({code for file in (ROOT / "services").rglob("*.py") for code in CODE.findall(file.read_text(encoding="utf-8"))})
README = (ROOT / "README.md").read_text(encoding="utf-8")


def test_the_codes_are_found() -> None:
    assert {"unit_excluded", "balises_missed", "wheel_diameter"} <= set(CODES)


@pytest.mark.parametrize("code", CODES)
def test_readme_explains_an_event(code: str) -> None:
    assert f"`{code}`" in README
