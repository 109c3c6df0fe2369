"""Shared by all tests. Its place in this folder is what makes `examples` importable from every test."""

from __future__ import annotations

import sys
from pathlib import Path

import pytest
from hypothesis import settings

# without deadlines: shared machines stall; derandomised: the same examples on every machine, no rerun decides anything
settings.register_profile("milepost", deadline=None, derandomize=True, max_examples=60)
# for make test-fast: pytest --hypothesis-profile=fast
settings.register_profile("fast", deadline=None, derandomize=True, max_examples=15)
settings.load_profile("milepost")

# the plugin of the fixture `stack`, also where this project is not installed
pytest_plugins = ["milepost.testing"]

sys.path.insert(0, str(Path(__file__).parent))


@pytest.fixture(scope="session")
def root() -> Path:
    """The repository's folder."""
    return Path(__file__).resolve().parent.parent
