"""A pytest plugin for chaos tests of your own: the fixture `stack` is a running train that a test may break."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from milepost.chaos.stack import Stack


@pytest.fixture(scope="session")
def milepost_train() -> str:
    """The train that `stack` runs: a file or a name. Define a fixture of this name to use another."""
    return "full"


@pytest.fixture
def stack(milepost_train: str) -> Iterator[Stack]:
    """A running train that is well: every process there, every sensor in use. It ends with the test."""
    # imported here: the plugin is loaded by every pytest of the environment
    from milepost.chaos.stack import NORMAL_S, Stack

    with Stack(milepost_train) as running:
        running.recovered(NORMAL_S)
        yield running
