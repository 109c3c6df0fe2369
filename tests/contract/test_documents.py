"""What is made from tables and models: complete, up to date, and valid by the standards that it names."""

from __future__ import annotations

import copy
import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
import typer
import yaml

from examples import examples_of
from milepost.cli.documents.config_models import FILES, LIKE, keys_of, meaning, models, table
from milepost.cli.documents.config_schemas import config_schema
from milepost.cli.main import app
from milepost.cli.schema import CONFIG, document_files, run_schema
from milepost.config.yaml_files import read_yaml
from milepost.simulation.faults import FAULTS as KINDS_OF_FAULT
from milepost_schemas import EVENT_CODES, ROOT, STREAMS, Stream
from milepost_schemas.asyncapi import asyncapi
from milepost_schemas.documents import json_schema, schema_names
from milepost_schemas.meanings import MEANINGS

OFFICIAL = json.loads((Path(__file__).parent / "asyncapi/3.0.0-without-id.json").read_text(encoding="utf-8"))
DEPLOYED = sorted((kind, path) for kind in FILES for path in (Path("deploy") / f"{kind}s").glob("*.yaml"))
# options of kinds of fault, which have a table of their own
FAULTS = {key for row in KINDS_OF_FAULT.values() for key in row.options.model_fields}
each_file = pytest.mark.parametrize("kind", sorted(FILES))
each_message = pytest.mark.parametrize("name", sorted(schema_names()))


def valid(content: object, schema: dict[str, Any]) -> list[str]:
    return [error.message for error in jsonschema.Draft202012Validator(schema).iter_errors(content)]


def properties(schema: object) -> Iterator[tuple[str, dict[str, Any]]]:
    """Every property anywhere in a schema."""
    if isinstance(schema, dict):
        if isinstance(schema.get("properties"), dict):
            yield from schema["properties"].items()
        for inner in schema.values():
            yield from properties(inner)
    elif isinstance(schema, list):
        for inner in schema:
            yield from properties(inner)


def test_the_documents_are_those_of_the_tables_and_no_others(root: Path) -> None:
    files = document_files()
    for name, content in files.items():
        assert (root / name).read_text(encoding="utf-8") == content, f"{name}: run `make schema`"
    assert {f"{CONFIG}/{path.name}" for path in (root / CONFIG).iterdir()} == {n for n in files if n.startswith(CONFIG)}


def test_a_document_that_differs_is_named_and_written_where_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run_schema(tmp_path, check=True) == 1
    assert list(tmp_path.iterdir()) == []
    assert run_schema(tmp_path, check=False) == 0
    assert run_schema(tmp_path, check=True) == 0
    (tmp_path / "schemas/asyncapi.json").write_text("{}", encoding="utf-8")
    capsys.readouterr()
    assert run_schema(tmp_path, check=True) == 1
    assert capsys.readouterr().err == f"differs: {tmp_path}/schemas/asyncapi.json\n"


@each_message
def test_a_message_has_an_identity_and_every_field_a_description(name: str) -> None:
    schema = json_schema(name)
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["$id"] == f"urn:milepost:{name}"
    assert schema["description"]
    undescribed = [key for key, field in properties(schema) if not field.get("description")]
    assert undescribed == [], "say in milepost_schemas/meanings.py what they mean"


@pytest.mark.parametrize("row", STREAMS, ids=lambda row: row.name)
def test_a_message_is_valid_by_its_json_schema(row: Stream) -> None:
    schema = json_schema(f"{row.message.SCHEMA}-{row.message.VERSION}")
    for message in examples_of(row):
        fields = message.model_dump(mode="json")
        assert valid(fields, schema) == []
        assert valid({**fields, "added_later": 1}, schema) == []
        assert valid({**fields, "sequence": -1}, schema) != []
        assert valid({key: value for key, value in fields.items() if key != "train"}, schema) != []


def test_no_meaning_of_a_message_is_left_over() -> None:
    titles = {model.__name__ for model in schema_names().values()} | {"Message"}
    titles |= {title for name in schema_names() for title in json_schema(name).get("$defs", {})}
    assert set(MEANINGS) == titles


def test_every_key_of_a_configuration_file_has_a_meaning_and_none_is_left_over() -> None:
    known = {name: set[str]() for model in models() for name in (each.__name__ for each in model.__mro__)}
    for model in models():
        for key in keys_of(model):
            assert meaning(model, key), f"{model.__name__}.{key}: say in cli/documents/meanings.yaml what it means"
            for each in model.__mro__:
                known[each.__name__].add(key)
    for name, rows in table().items():
        assert set(rows) - {LIKE} <= known.get(name, set()), name


@each_file
def test_a_configuration_schema_has_an_identity_and_every_key_a_description(kind: str) -> None:
    schema = config_schema(kind)
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["$id"] == f"urn:milepost:config:{kind}"
    # `kind` among a filter's options names the filter, and is its own description
    undescribed = {key for key, field in properties(schema) if not field.get("description")}
    assert undescribed <= {"kind"}


@pytest.mark.parametrize(("kind", "path"), DEPLOYED, ids=lambda value: value if isinstance(value, str) else value.stem)
def test_a_shipped_file_is_valid_by_its_schema(kind: str, path: Path) -> None:
    assert valid(read_yaml(path), config_schema(kind)) == []


@pytest.mark.parametrize(
    ("kind", "path", "change"),
    [
        ("train", "metro", {"chaoss": True}),
        ("train", "metro", {"fusion": {"period_ms": 0}}),
        ("train", "metro", {"units": {"radar-1": {"kind": "sonar"}}}),
        ("train", "metro", {"units": {"radar-1": {"kind": "doppler_radar", "diameter_m": 1.0}}}),
        ("train", "metro", {"units": {"radar-1": {"kind": "doppler_radar", "filter": "kalmann"}}}),
        ("train", "metro", {"units": {"radar-1": {"kind": "doppler_radar", "filter": {"kind": "rls", "degrees": 3.0}}}}),
        ("line", "metro", {"length_m": -1.0}),
        ("fleet", "three-trains", {"trains": []}),
        ("scenario", "odometer-radar", {"faults": [{"unit": "radar", "kind": "bias", "from_s": 1.0}]}),
        (
            "scenario",
            "odometer-radar",
            {"faults": [{"unit": "radar", "kind": "bias", "from_s": 1.0, "size": 1.0, "ratio": 2.0}]},
        ),
        ("scenario", "odometer-radar", {"faults": [{"unit": "radar", "kind": "biass", "from_s": 1.0, "size": 1.0}]}),
        ("campaign", "pairs", {"trains": {}}),
    ],
)
def test_what_a_file_may_not_say_its_schema_refuses(kind: str, path: str, change: dict[str, Any]) -> None:
    content = read_yaml(Path("deploy") / f"{kind}s" / f"{path}.yaml")
    assert valid({**content, **change}, config_schema(kind)) != []


@pytest.mark.parametrize("filter_", ["kalman", None, {"kind": "rls"}, {"kind": "rls", "forgetting": 0.8}])
def test_a_filter_may_be_a_name_or_a_name_with_options(filter_: object) -> None:
    content = read_yaml(Path("deploy/trains/metro.yaml"))
    assert valid({**content, "units": {"radar": {"kind": "doppler_radar", "filter": filter_}}}, config_schema("train")) == []


@pytest.mark.parametrize("path", sorted(Path("deploy").glob("*/*.yaml")), ids=str)
def test_a_hint_for_editors_names_a_schema_that_is_there(path: Path) -> None:
    for hint in re.findall(r"^# yaml-language-server: \$schema=(.*)$", path.read_text(encoding="utf-8"), re.M):
        assert (path.parent / hint).is_file()
        assert (path.parent / hint).name == f"{path.parent.name.removesuffix('s')}.schema.json"


def test_the_reference_has_a_row_for_every_key(root: Path) -> None:
    text = (root / "docs/reference-configuration.md").read_text(encoding="utf-8")
    first_cells = re.findall(r"^\| (`.*?`) \|", text, re.M)
    rows = {re.findall(r"`([^`]+)`", cell)[-1] for cell in first_cells}
    assert rows == {key for model in models() for key in keys_of(model)} | FAULTS
    assert len(first_cells) > 300


def rows_of(root: Path, name: str) -> dict[str, list[str]]:
    """The first cells of the tables of a made document, by heading."""
    found: dict[str, list[str]] = {}
    heading = ""
    for line in (root / f"docs/reference-{name}.md").read_text(encoding="utf-8").splitlines():
        heading = line.removeprefix("## ") if line.startswith("## ") else heading
        found.setdefault(heading, []).extend(re.findall(r"^\| `(.*?)` \|", line))
    return found


def test_the_reference_has_a_section_for_every_message_and_a_row_for_every_field(root: Path) -> None:
    found = rows_of(root, "messages")
    shared = set(found["What every message has"])
    for name in schema_names():
        schema = json_schema(name)
        assert set(found[name]) == set(schema["properties"]) - (shared if "train" in schema["properties"] else set())
        for title, part in schema.get("$defs", {}).items():
            known = title in found or title in {model.__name__ for model in schema_names().values()}
            assert known or "properties" not in part, title
    assert found[""] == [row.key for row in STREAMS]


def test_the_reference_has_a_row_for_every_event(root: Path) -> None:
    assert rows_of(root, "events")[""] == [row.code for row in EVENT_CODES]


def test_the_reference_has_a_section_for_every_command_and_a_row_for_every_option(root: Path) -> None:
    found = rows_of(root, "commands")
    group: Any = typer.main.get_group(app)
    seen = {f"milepost {name}": command for name, command in group.commands.items() if not command.hidden}
    seen |= {f"milepost pki {name}": command for name, command in seen["milepost pki"].commands.items()}
    assert set(found) - {""} == set(seen)
    for name, command in seen.items():
        shown = [each for each in command.params if each.name != "help" and not each.hidden]
        options = {each.opts[0] for each in shown if each.param_type_name == "option"}
        assert options == {cell for cell in found[name] if cell.startswith("--")}, name
        assert len(found[name]) == len(shown), name


def official(document: object) -> list[str]:
    return [error.message for error in jsonschema.Draft7Validator(OFFICIAL).iter_errors(document)]


def test_the_asyncapi_document_is_valid_by_the_official_schema() -> None:
    document = asyncapi()
    assert official(document) == []
    for path in (("info", "title"), ("channels", "state", "address"), ("operations", "sendState", "action")):
        spoilt: Any = copy.deepcopy(document)
        inner = spoilt
        for name in path[:-1]:
            inner = inner[name]
        inner[path[-1]] = 5
        assert official(spoilt) != [], path


def test_every_reference_of_the_asyncapi_document_leads_somewhere(root: Path) -> None:
    document, text = asyncapi(), json.dumps(asyncapi())
    references = set(re.findall(r'"\$ref": "([^"]+)"', text))
    assert len(references) > 2 * len(STREAMS)
    for reference in references:
        if not reference.startswith("#"):
            assert (root / "schemas" / reference).is_file(), reference
            continue
        found: Any = document
        for name in reference.removeprefix("#/").split("/"):
            found = found[name]


@pytest.mark.parametrize("row", STREAMS, ids=lambda row: row.name)
def test_every_stream_is_a_channel_with_its_message_and_encoding(row: Stream) -> None:
    document = asyncapi()
    channels = [c for c in document["channels"].values() if c["address"] == f"{ROOT}/{{train}}/{row.key}"]
    assert len(channels) == 1
    assert row.message.SCHEMA in channels[0]["messages"]
    assert document["components"]["messages"][row.message.SCHEMA]["contentType"] == row.message.encoding()
    assert set(re.findall(r"{(\w+)}", channels[0]["address"])) == set(channels[0]["parameters"])


def test_the_table_of_meanings_has_no_key_twice() -> None:
    text = (Path(__file__).parents[2] / "services/milepost/cli/documents/meanings.yaml").read_text(encoding="utf-8")
    assert yaml.safe_load(text) == read_yaml(Path("services/milepost/cli/documents/meanings.yaml"))
