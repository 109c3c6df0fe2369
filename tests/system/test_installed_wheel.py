"""The two wheels work alone: in a fresh environment and an empty folder."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest
import yaml

from conftest import free_port

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[2]


class Installed:
    """`milepost` from the wheels, with this environment's other packages beside it."""

    def __init__(self, folder: Path) -> None:
        self.wheels = folder / "wheels"
        self.empty = folder / "empty"
        self.empty.mkdir()
        self._environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
        pip = [sys.executable, "-m", "pip", "--disable-pip-version-check"]
        build = ["wheel", "--quiet", "--no-deps", "--no-build-isolation", "--wheel-dir", str(self.wheels)]
        self._run(*pip, *build, str(ROOT / "schemas"), str(ROOT))
        home = folder / "environment"
        venv.create(home, with_pip=False)
        self._bin = home / "bin"
        packages = Path(sysconfig.get_path("purelib", vars={"base": str(home)}))
        # a folder that a .pth file names has its own .pth files ignored, so no editable install of Milepost is found
        (packages / "others.pth").write_text(sysconfig.get_path("purelib") + "\n", encoding="utf-8")
        install = ["install", "--quiet", "--no-deps", "--no-index", "--ignore-installed"]
        self._run(*pip, "--python", str(self._bin / "python"), *install, *map(str, sorted(self.wheels.iterdir())))

    def _run(self, *command: str) -> subprocess.CompletedProcess[str]:
        done = subprocess.run(
            command, cwd=self.empty, env=self._environment, capture_output=True, text=True, timeout=120, check=False
        )
        self.last = done
        return done

    def milepost(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        return self._run(str(self._bin / "milepost"), *arguments)

    def python(self, program: str) -> str:
        return self._run(str(self._bin / "python"), "-c", program).stdout.strip()


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    made = Installed(tmp_path_factory.mktemp("wheel"))
    assert made.last.returncode == 0, made.last.stderr
    return made


def test_both_wheels_are_built_with_their_licence(installed: Installed) -> None:
    names = {path.name.split("-")[0]: path for path in installed.wheels.iterdir()}
    assert set(names) == {"milepost", "milepost_schemas"}
    licence = (ROOT / "LICENSE").read_bytes()
    for path in names.values():
        with zipfile.ZipFile(path) as wheel:
            inside = [name for name in wheel.namelist() if name.endswith("licenses/LICENSE")]
            assert [wheel.read(name) for name in inside] == [licence]


def test_the_code_that_runs_is_the_wheels(installed: Installed) -> None:
    for package in ("milepost", "milepost_schemas"):
        where = installed.python(f"import {package}; print({package}.__file__)")
        assert where.startswith(str(installed.empty.parent / "environment")), where


def test_every_train_line_and_scenario_is_inside(installed: Installed) -> None:
    inside = Path(installed.python("import milepost; print(milepost.__path__[0])")) / "deploy"
    for folder in ("trains", "lines", "scenarios", "zenoh"):
        expected = {path.name: path.read_bytes() for path in (ROOT / "deploy" / folder).iterdir()}
        assert {path.name: path.read_bytes() for path in (inside / folder).iterdir()} == expected


def test_up_runs_in_an_empty_folder(installed: Installed) -> None:
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    done = installed.milepost("up", "--headless", "--duration", "3", "--listen", endpoint, "--report", "report.json")
    assert done.returncode == 0, done.stderr
    report = installed.empty / "report.json"
    found = json.loads(report.read_text(encoding="utf-8"))
    report.unlink()
    assert found["states"] >= 100
    assert found["truth"]["outside_interval"] == 0
    assert list(installed.empty.iterdir()) == []


def test_a_shipped_scenario_is_evaluated_by_name(installed: Installed) -> None:
    done = installed.milepost("evaluate", "odometer-radar", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["estimators"]["fused"]["position_max_m"] < 1.0


@pytest.mark.parametrize("train", ["brussels-28876", "comma2k19"])
def test_a_train_without_its_recording_says_so(installed: Installed, train: str) -> None:
    done = installed.milepost("up", "--train", train)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr
    mistake = done.stderr.splitlines()[-1]
    assert f"{train}.yaml: " in mistake
    assert "shared/data" in mistake


def test_a_compose_file_is_printed_for_an_image_that_is_built_elsewhere(installed: Installed) -> None:
    """GIVEN no repository, THEN the file of a shipped train mounts the wheel's files, and no service builds the image."""
    done = installed.milepost("compose", "metro", "--page")
    assert done.returncode == 0, done.stderr
    found = yaml.safe_load(done.stdout)
    assert not [name for name, service in found["services"].items() if "build" in service]
    inside = Path(installed.python("import milepost; print(milepost.__path__[0])")) / "deploy"
    sources = [each["source"] for each in found["x-process"]["volumes"]]
    assert sources == [str(inside / "trains" / "metro.yaml"), str(inside / "lines" / "metro.yaml")]


def test_a_scenario_without_its_recording_is_skipped(installed: Installed) -> None:
    done = installed.milepost("evaluate", "--all", "--only", "comma2k19")
    assert done.returncode == 0, done.stderr
    assert "skipped comma2k19" in done.stderr
