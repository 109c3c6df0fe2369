"""The tables agree with each other, and the rooms keep to what they may know."""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from examples import EXAMPLES, SENSOR_OPTIONS, options_of
from milepost.estimation.filters import FILTERS
from milepost.estimation.fusion import RULES
from milepost.estimation.layout import COMMON
from milepost.evaluation.scores import SCORES
from milepost.runtime.config import load_train
from milepost.runtime.roles import ROLES, process_name, processes
from milepost.sensors import SENSORS
from milepost.sensors.base import Sensor
from milepost_schemas import BY_NAME, COMMON_STATES, STREAMS

ROOT = Path(__file__).resolve().parents[2]
SERVICES = ROOT / "services" / "milepost"
SCHEMAS = ROOT / "schemas" / "milepost_schemas"
LONGEST_FILE = 250


# tables --------------------------------------------------------------------------------------------------------------------


def test_the_stream_table_can_be_asked_by_name() -> None:
    assert list(BY_NAME.values()) == list(STREAMS)
    assert set(EXAMPLES) == set(BY_NAME), "tests/examples.py: EXAMPLES and the stream table differ"


def test_the_sensor_table_has_every_kind_in_the_folder() -> None:
    found = {
        node.name
        for path in (SERVICES / "sensors").glob("*.py")
        if path.name != "base.py"
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ClassDef)
        and any("Sensor[" in ast.unparse(base) for base in node.bases)
        # what several kinds have in common is no kind
        and any(ast.unparse(line).startswith("kind = ") for line in node.body)
    }
    assert {kind.__name__ for kind in SENSORS.values()} == found
    assert set(SENSORS) == set(SENSOR_OPTIONS), "tests/examples.py: SENSOR_OPTIONS and the sensor table differ"


@pytest.mark.parametrize("kind", sorted(SENSORS))
def test_a_sensors_row_is_consistent_with_the_other_tables(kind: str) -> None:
    row = SENSORS[kind]
    assert issubclass(row, Sensor)
    assert row.kind == kind
    assert row.stream in BY_NAME
    assert BY_NAME[row.stream].key.startswith("reading/")
    options = row.options_model.model_validate(options_of(kind))
    assert options.filter is None or options.filter in FILTERS
    assert (SERVICES / "sensors" / f"{kind}.py").is_file(), "one file for each kind, called like it"


@pytest.mark.parametrize("name", sorted(FILTERS))
def test_a_filter_can_be_named_in_a_train_file(name: str) -> None:
    assert name.replace("_", "").isalnum()
    assert name.islower()
    assert callable(FILTERS[name].take)


def test_filters_and_rules_are_each_something_else() -> None:
    assert len(set(FILTERS.values())) == len(FILTERS)
    assert len(set(RULES.values())) == len(RULES)
    assert "kalman" in FILTERS
    assert {"information", "federated"} <= set(RULES)


@pytest.mark.parametrize("name", sorted(SCORES))
def test_a_score_can_be_asked_for_by_a_scenario_file_and_refuses_options_that_it_does_not_have(name: str) -> None:
    assert name.replace("_", "").isalnum()
    assert name.islower()
    assert SCORES[name].options.model_config["extra"] == "forbid"


def test_the_role_table_is_filed_by_name_and_listeners_come_before_speakers() -> None:
    assert all(role.name == name for name, role in ROLES.items())
    order = list(ROLES)
    assert order.index("fuser") < order.index("filter") < order.index("sensor") < order.index("world")
    assert order.index("balise") < order.index("sensor")
    assert all(role.purpose for role in ROLES.values())


def test_process_names_are_unique_and_can_stand_in_a_key() -> None:
    train = load_train(ROOT / "deploy" / "trains" / "maglev.yaml")
    listed = processes(train)
    assert len({process.name for process in listed}) == len(listed)
    for process in listed:
        assert process.name == process_name(process.role, process.unit)
        assert BY_NAME["health"].key_for(train.name, process.name).count("/") == 4
    assert {process.role for process in listed} == set(ROLES)


def test_contract_and_estimator_mean_the_same_common_states() -> None:
    assert tuple(COMMON) == tuple(COMMON_STATES)


# rooms ---------------------------------------------------------------------------------------------------------------------


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
    late = set(imports(SERVICES / "estimation" / "track.py")) - set(imports(SERVICES / "estimation" / "track.py", True))
    assert {"pyproj", "shapely"} <= late


@pytest.mark.parametrize("path", modules(SERVICES / "estimation"), ids=id_of)
def test_estimation_is_pure_mathematics(path: Path) -> None:
    impure = {
        "time", "datetime", "logging", "os", "sys", "io", "socket", "threading", "subprocess", "signal", "random", "pathlib",
        "asyncio", "multiprocessing", "queue", "tempfile", "shutil", "warnings", "urllib", "http",
    }  # fmt: skip
    for name in imports(path):
        top = name.split(".")[0]
        assert top not in impure, f"{id_of(path)} imports {name}"
        known = top in sys.stdlib_module_names or top in {"numpy", "pyproj", "shapely"}
        assert known or is_of(name, "milepost.estimation"), f"{id_of(path)} imports {name}"


@pytest.mark.parametrize("path", modules(SERVICES / "estimation"), ids=id_of)
def test_estimation_neither_prints_nor_opens_files(path: Path) -> None:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            assert node.func.id not in {"print", "open", "input", "exec", "eval", "__import__"}, f"line {node.lineno}"


@pytest.mark.parametrize("path", modules(SERVICES / "nodes"), ids=id_of)
def test_nodes_know_neither_zenoh_nor_a_clock_nor_who_runs_them(path: Path) -> None:
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
        assert not is_of(name, "milepost.runtime"), f"{id_of(path)} imports {name}"
        assert not is_of(name, "milepost.cli"), f"{id_of(path)} imports {name}"


@pytest.mark.parametrize("path", modules(SERVICES), ids=id_of)
def test_only_commands_know_the_evaluation_and_it_knows_no_command(path: Path) -> None:
    room = path.relative_to(SERVICES).parts[0]
    for name in imports(path):
        assert room in {"evaluation", "cli"} or not is_of(name, "milepost.evaluation"), f"{id_of(path)} imports {name}"
        assert room != "evaluation" or not is_of(name, "milepost.cli"), f"{id_of(path)} imports {name}"


@pytest.mark.parametrize("path", modules(SERVICES / "sensors") + modules(SERVICES / "simulation"), ids=id_of)
def test_sensors_and_simulation_know_neither_clock_nor_bus_nor_nodes_nor_the_timeline(path: Path) -> None:
    for name in imports(path):
        assert name.split(".")[0] not in {"zenoh", "time", "logging", "os", "random"}, f"{id_of(path)} imports {name}"
        for room in ("runtime", "cli", "nodes", "estimation.timeline", "estimation.estimator", "estimation.fusion"):
            assert not is_of(name, f"milepost.{room}"), f"{id_of(path)} imports {name}"


@pytest.mark.parametrize("path", modules(SERVICES), ids=id_of)
def test_only_the_runtime_knows_zenoh_and_tools_that_listen_import_it_late(path: Path) -> None:
    room = path.relative_to(SERVICES).parts[0]
    anywhere = any(is_of(name, "zenoh") for name in imports(path))
    at_the_top = any(is_of(name, "zenoh") for name in imports(path, top_level_only=True))
    assert not anywhere or room in {"runtime", "cli"}
    assert not at_the_top or room == "runtime" or path.name == "listening.py"


@pytest.mark.parametrize("path", modules(SCHEMAS), ids=id_of)
def test_the_contract_needs_pydantic_and_msgpack_alone(path: Path) -> None:
    for name in imports(path):
        top = name.split(".")[0]
        known = top in sys.stdlib_module_names or top in {"pydantic", "msgpack"}
        assert known or is_of(name, "milepost_schemas"), f"{id_of(path)} imports {name}"


@pytest.mark.parametrize("path", modules(SERVICES) + modules(SCHEMAS), ids=id_of)
def test_nothing_is_imported_by_the_name_of_its_folder(path: Path) -> None:
    assert not {name.split(".")[0] for name in imports(path)} & {"services", "schemas", "tests", "examples"}


@pytest.mark.parametrize("path", modules(SERVICES) + modules(SCHEMAS), ids=id_of)
def test_a_file_can_be_read_in_one_sitting(path: Path) -> None:
    length = len(path.read_text(encoding="utf-8").splitlines())
    assert length <= LONGEST_FILE, f"{length} lines"


@pytest.mark.parametrize("path", modules(SERVICES) + modules(SCHEMAS), ids=id_of)
def test_a_module_says_what_it_is_for(path: Path) -> None:
    assert ast.get_docstring(ast.parse(path.read_text(encoding="utf-8")))
