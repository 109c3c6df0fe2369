"""Hostile bytes for every decoder: `python -m tests.fuzz`, and a short selection in `make test`."""

from __future__ import annotations

import sys
from pathlib import Path

# for `examples`, which the tests use
sys.path.insert(0, str(Path(__file__).parents[1]))
