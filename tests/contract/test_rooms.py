"""The rooms: what each may import, and how large it may grow."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SERVICES = ROOT / "services" / "milepost"
SCHEMAS = ROOT / "schemas" / "milepost_schemas"
# from the top of the house to the bottom
FLOORS = (
    "cli",
    "chaos",
    "campaign",
    "evaluation",
    "checks",
    "security",
    "runtime",
    "offline",
    "recorder",
    "config",
    "nodes",
    "page",
    "feeds",
    "sensors",
    "simulation",
    "recordings",
    "fusion",
    "estimation",
    "track",
)
LONGEST_FILE = 250
LARGEST_ROOM = 2000


def modules(folder: Path) -> list[Path]:
    found = sorted(folder.rglob("*.py"))
    assert found, f"{folder} has no modules: this test would prove nothing"
    return found


def package_of(path: Path) -> list[str]:
    base = SERVICES.parent if path.is_relative_to(SERVICES) else SCHEMAS.parent
    return list(path.relative_to(base).parent.parts)


def imports(path: Path, top_level_only: bool = False) -> Iterator[str]:
    """Full dotted names of everything a file imports; with `top_level_only` not what its functions import."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    inside = {
        id(node)
        for function in ast.walk(tree)
        if isinstance(function, ast.FunctionDef | ast.AsyncFunctionDef | ast.Lambda)
        for node in ast.walk(function)
    }
    for node in ast.walk(tree):
        if top_level_only and id(node) in inside:
            continue
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            package = package_of(path)
            above = package[: len(package) - node.level + 1] if node.level else []
            module = ".".join([*above, *([node.module] if node.module else [])])
            # `from milepost import runtime` imports milepost.runtime
            yield from (f"{module}.{alias.name}" for alias in node.names)


def is_of(name: str, module: str) -> bool:
    return name == module or name.startswith(f"{module}.")


def id_of(path: Path) -> str:
    return str(path.relative_to(ROOT))


def test_relative_imports_are_understood() -> None:
    """The rules below stand on this."""
    names = set(imports(SERVICES / "nodes" / "balise.py"))
    assert "milepost.nodes.base.Node" in names
    assert "milepost_schemas.AbsoluteFix" in names
    late = set(imports(SERVICES / "track" / "track.py")) - set(imports(SERVICES / "track" / "track.py", True))
    assert "pyproj" in late


@pytest.mark.parametrize("path", modules(SERVICES / "estimation") + modules(SERVICES / "fusion"), ids=id_of)
def test_estimation_is_pure_mathematics(path: Path) -> None:
    impure = {
        "time", "datetime", "logging", "os", "sys", "io", "socket", "threading", "subprocess", "signal", "random", "pathlib",
        "asyncio", "multiprocessing", "queue", "tempfile", "shutil", "warnings", "urllib", "http",
    }  # fmt: skip
    for name in imports(path):
        top = name.split(".")[0]
        assert top not in impure, f"{id_of(path)} imports {name}"
        known = top in sys.stdlib_module_names or top == "numpy"
        assert known or is_of(name, "milepost.estimation") or is_of(name, "milepost.fusion"), f"{id_of(path)} imports {name}"


@pytest.mark.parametrize("path", modules(SERVICES / "estimation") + modules(SERVICES / "fusion"), ids=id_of)
def test_estimation_neither_prints_nor_opens_files(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in {"print", "open", "input", "exec", "eval", "__import__"}, f"line {node.lineno}"


@pytest.mark.parametrize("path", modules(SERVICES / "nodes"), ids=id_of)
def test_nodes_know_neither_zenoh_nor_a_clock(path: Path) -> None:
    for name in imports(path):
        assert name.split(".")[0] not in {
            "zenoh",
            "time",
            "datetime",
            "logging",
            "os",
            "signal",
            "socket",
            "threading",
            "queue",
        }


def room_of(path: Path) -> str:
    return path.relative_to(SERVICES).parts[0]


def test_every_folder_is_a_package_on_one_level() -> None:
    folders = {path.name for path in SERVICES.iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders == set(FLOORS)


@pytest.mark.parametrize("path", modules(SERVICES), ids=id_of)
def test_a_package_imports_only_packages_below_it(path: Path) -> None:
    room = room_of(path)
    if room not in FLOORS:  # the package itself and `python -m milepost`
        return
    allowed = FLOORS[FLOORS.index(room) :]
    for name in imports(path):
        if is_of(name, "milepost"):
            assert name.split(".")[1] in allowed, f"{id_of(path)} imports {name}"


def test_no_modules_import_each_other_in_a_circle() -> None:
    known = {".".join(path.relative_to(SERVICES.parent).with_suffix("").parts): path for path in modules(SERVICES)}
    needs = {
        name: {m for found in imports(path, True) for m in (found, found.rpartition(".")[0]) if m in known} - {name}
        for name, path in known.items()
    }
    left = dict(needs)
    while left:
        free = {name for name, others in left.items() if not others & set(left)}
        assert free, f"a circle among {', '.join(sorted(left))}"
        left = {name: others for name, others in left.items() if name not in free}


@pytest.mark.parametrize("folder", sorted({path.parent for path in modules(SERVICES)}), ids=id_of)
def test_a_package_has_a_bounded_number_of_lines(folder: Path) -> None:
    length = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in folder.glob("*.py"))
    assert length <= LARGEST_ROOM, f"{length} lines"


@pytest.mark.parametrize("path", modules(SERVICES / "sensors") + modules(SERVICES / "simulation"), ids=id_of)
def test_sensors_and_simulation_know_neither_clock_nor_timeline(path: Path) -> None:
    for name in imports(path):
        assert name.split(".")[0] not in {"zenoh", "time", "logging", "os", "random"}, f"{id_of(path)} imports {name}"
        for module in ("timeline", "estimator", "fusion"):
            assert not is_of(name, f"milepost.estimation.{module}"), f"{id_of(path)} imports {name}"


@pytest.mark.parametrize("path", modules(SERVICES), ids=id_of)
def test_only_the_runtime_knows_zenoh_and_tools_that_listen_import_it_late(path: Path) -> None:
    room = room_of(path)
    anywhere = any(is_of(name, "zenoh") for name in imports(path))
    at_the_top = any(is_of(name, "zenoh") for name in imports(path, top_level_only=True))
    assert not anywhere or room in {"runtime", "cli"} or path.relative_to(SERVICES) == Path("chaos/relay.py")
    assert not at_the_top or room == "runtime" or path.name == "listening.py"


@pytest.mark.parametrize("path", modules(SCHEMAS), ids=id_of)
def test_the_contract_needs_pydantic_and_msgpack_alone(path: Path) -> None:
    for name in imports(path):
        top = name.split(".")[0]
        known = top in sys.stdlib_module_names or top in {"pydantic", "msgpack"}
        assert known or is_of(name, "milepost_schemas"), f"{id_of(path)} imports {name}"


@pytest.mark.parametrize("path", modules(SERVICES) + modules(SCHEMAS), ids=id_of)
def test_no_import_uses_the_name_of_a_source_folder(path: Path) -> None:
    assert not {name.split(".")[0] for name in imports(path)} & {"services", "schemas", "tests", "examples"}


@pytest.mark.parametrize("path", modules(SERVICES) + modules(SCHEMAS), ids=id_of)
def test_a_file_has_a_bounded_number_of_lines(path: Path) -> None:
    length = len(path.read_text(encoding="utf-8").splitlines())
    assert length <= LONGEST_FILE, f"{length} lines"


@pytest.mark.parametrize("path", modules(SERVICES) + modules(SCHEMAS), ids=id_of)
def test_a_module_has_a_docstring(path: Path) -> None:
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
