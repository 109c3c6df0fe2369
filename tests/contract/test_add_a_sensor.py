"""docs/add-a-sensor.md followed to the letter, in a copy of the tree, leaves the contract tests green."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.long

ROOT = Path(__file__).resolve().parents[2]
GUIDE = (ROOT / "docs/add-a-sensor.md").read_text(encoding="utf-8")
FOLDERS = ("services", "schemas", "deploy", "docs", "tests")
FILES = (
    "compose.yaml",
    "compose.record.yaml",
    "compose.secure.yaml",
    "pyproject.toml",
    "Makefile",
    "LICENSE",
    "README.md",
    "CONTRIBUTING.md",
    "SECURITY.md",
)
# all that looks at the kinds of sensors, at trains and at rooms
TESTS = ("tests/contract", "tests/unit/test_sensors.py", "tests/unit/test_sensor_node.py", "tests/unit/test_column_map.py")
ITSELF = "--ignore=tests/contract/test_add_a_sensor.py"
WHICH = "optical or test_tables or test_compose_file or test_readme or test_documents"
RUN = """
from pathlib import Path
from milepost.config.shipped_files import find_file
from milepost.config.train import load_train
from milepost.offline.run import simulate
states = []
simulate(load_train(find_file(Path("mine"), "trains")), 3.0, None, states.append)
print({sensor.unit: sensor.share for sensor in states[-1].sensors}["optical"])
"""


class Copy:
    """A copy of the tree, with commands run in it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        for name in FOLDERS:
            shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
        for name in FILES:
            shutil.copy(ROOT / name, folder)

    def edit(self, path: str, change: dict[str, str]) -> None:
        text = (self.folder / path).read_text(encoding="utf-8")
        for old, new in change.items():
            assert text.count(old) == 1, f"{path}: {old!r}"
            text = text.replace(old, new)
        (self.folder / path).write_text(text, encoding="utf-8")

    def python(self, *arguments: str) -> str:
        paths = os.pathsep.join(str(self.folder / name) for name in ("services", "schemas"))
        environment = {**os.environ, "PYTHONPATH": paths, "PYTHONDONTWRITEBYTECODE": "1"}
        command = [sys.executable, *arguments]
        done = subprocess.run(
            command, cwd=self.folder, env=environment, capture_output=True, text=True, timeout=300, check=False
        )
        assert done.returncode == 0, done.stdout[-4000:] + done.stderr[-4000:]
        return done.stdout


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", GUIDE, re.S)


@pytest.fixture(scope="module")
def followed(tmp_path_factory: pytest.TempPathFactory) -> Copy:
    """The guide's first three steps done."""
    if (ROOT / "services/milepost/sensors/optical.py").exists():
        pytest.skip("the guide has been followed in this tree itself")
    copy = Copy(tmp_path_factory.mktemp("tree"))
    kind, row_import, row = blocks("python")
    (entry,) = blocks("yaml")
    (copy.folder / "services/milepost/sensors/optical.py").write_text(kind, encoding="utf-8")
    radar = "from .radar.doppler_radar"
    copy.edit(
        "services/milepost/sensors/__init__.py",
        {radar: row_import + radar, "        BaliseReader,\n": f"        BaliseReader,\n    {row}"},
    )
    trains = copy.folder / "deploy/trains"
    full = (trains / "full.yaml").read_text(encoding="utf-8")
    (trains / "mine.yaml").write_text(full + entry, encoding="utf-8")
    copy.python("-m", "milepost", "schema")
    return copy


@pytest.mark.slow
def test_the_tests_stay_green(followed: Copy) -> None:
    said = followed.python("-m", "pytest", "-p", "no:cacheprovider", "-vv", "-k", WHICH, ITSELF, *TESTS)
    assert "[optical]" in said
    assert "sensors/optical.py" in said


def test_the_example_is_formatted(followed: Copy) -> None:
    for check in (["check"], ["format", "--check"]):
        followed.python("-m", "ruff", *check, "services/milepost/sensors")


def test_the_new_unit_is_fused(followed: Copy) -> None:
    assert float(followed.python("-c", RUN)) > 0.0
