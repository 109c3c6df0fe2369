"""The benchmarks run: what they replace of the project changes beside them."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
# in a process of its own: it adds a rule to the table
PROGRAM = """
from pathlib import Path
from tests.bench.bank import measure_bank
found = measure_bank(Path("deploy/trains/maglev.yaml"), 1.0, 1)
assert found["hypotheses"] > 1 and min(found.values()) > 0.0, found
"""


@pytest.mark.slow
def test_the_fuser_s_step_is_measured_with_a_bank_and_with_one_belief() -> None:
    done = subprocess.run([sys.executable, "-c", PROGRAM], cwd=ROOT, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
