"""Wheels and inertial units beside a receiver's log: units, impossible numbers, gaps, axes."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from pathlib import Path

import pytest
import yaml

from milepost.cli.importing.job import run_import
from milepost.config.errors import ConfigError
from rides import BEGAN_S, SECONDS, SPEED_MPS, ride, write

G = 9.81
COLUMNS = ("ax_mps2", "ay_mps2", "az_mps2", "gx_radps", "gy_radps", "gz_radps")


def fixes(folder: Path) -> Path:
    """The log of a receiver that says no speed."""
    return write(folder, ["timestamp,lat,lon", *(f"{BEGAN_S + a.t:.1f},{a.lat:.7f},{a.lon:.7f}" for a in ride())])


def beside(folder: Path, name: str, header: str, rows: Sequence[str]) -> Path:
    path = folder / name
    path.write_text("\n".join([header, *rows]) + "\n", encoding="utf-8")
    return path


def imported(folder: Path, capsys, *logs: Path, unit: Sequence[str] = ()) -> dict:
    capsys.readouterr()
    assert run_import(logs, None, folder / "out", [], unit, False, True) == 0
    return json.loads(capsys.readouterr().out)


def wheel(folder: Path, number: float, column: str = "wheel_speed", odd: Sequence[int] = ()) -> Path:
    """A wheel's numbers ten times a second, with 99999 in some rows."""
    rows = [f"{BEGAN_S + i / 10:.1f},{99999 if i in odd else number}" for i in range(10 * SECONDS + 1)]
    return beside(folder, "wheel.csv", f"timestamp,{column}", rows)


def unit_of(said: dict, field: str) -> tuple[str, str]:
    (found,) = [row for row in said["columns"] if row["field"] == field]
    return found["unit"], found["found"]


@pytest.mark.parametrize(("number", "unit"), [(15.0, "m/s"), (54.0, "km/h"), (33.55, "mph"), (29.16, "kn")])
def test_a_wheels_unit_is_the_one_that_the_fixes_of_another_file_show(number: float, unit: str, tmp_path: Path, capsys) -> None:
    """Two cells of 99999 hide nothing: their legs are left out."""
    said = imported(tmp_path, capsys, fixes(tmp_path), wheel(tmp_path, number, odd=(100, 400)))
    assert unit_of(said, "wheel") == (unit, f"by name, {unit} as the places show")


@pytest.mark.parametrize(("number", "unit"), [(54.0, "km/h"), (1500.0, "cm/s"), (15.0, "m/s")])
def test_one_number_in_five_that_stands_for_none_hides_no_unit(number: float, unit: str, tmp_path: Path, capsys) -> None:
    """With one in thirty every other leg had one; the unit was assumed, and an honest receiver excluded."""
    said = imported(tmp_path, capsys, fixes(tmp_path), wheel(tmp_path, number, odd=range(0, 600, 5)))
    assert unit_of(said, "wheel") == (unit, f"by name, {unit} as the places show")
    assert "left out of wheel_speed: 120 rows beyond 200 m/s" in said["told"]


def test_a_wheel_whose_unit_can_only_be_another_one_is_one_line(tmp_path: Path) -> None:
    """In m/s, as is assumed of a train that stands, all would be beyond what trains reach."""
    still = write(tmp_path, ["timestamp,lat,lon", *(f"{BEGAN_S + a.t:.1f},{a.lat:.7f},{a.lon:.7f}" for a in ride())])
    with pytest.raises(ConfigError, match=r"wheel\.csv: wheel_speed_mps: only 0 rows are no faster than 200 m/s in m/s"):
        run_import([still, wheel(tmp_path, 99999.0, "wheel_speed_mps")], None, tmp_path / "out", [], ["wheel=m/s"], False, True)


@pytest.mark.parametrize(("noise_m", "least_m"), [(0.3, 0.8), (3.0, 3.0)])
def test_a_receivers_noise_is_no_less_than_its_fixes_show(noise_m: float, least_m: float, tmp_path: Path, capsys) -> None:
    """Fixes with 3 m of noise were said to have 1 m: the receiver was excluded as a liar in two states of three."""
    rows = [f"{BEGAN_S + a.t:.1f},{a.lat:.7f},{a.lon:.7f}" for a in ride(5.0, noise_m)]
    imported(tmp_path, capsys, write(tmp_path, ["timestamp,lat,lon", *rows]))
    std = yaml.safe_load((tmp_path / "out/train.yaml").read_text())["units"]["gnss"]["position_std_m"]["single"]
    assert least_m <= std <= 1.5 * least_m


def test_a_wheel_that_is_not_in_the_unit_of_its_name_is_one_line(tmp_path: Path, capsys) -> None:
    log, numbers = fixes(tmp_path), wheel(tmp_path, 54.0, "wheel_speed_mps")
    with pytest.raises(ConfigError, match="wheel: the column wheel_speed_mps is in m/s by its name, but the places show km/h"):
        run_import([log, numbers], None, tmp_path / "out", [], [], False, True)
    assert not (tmp_path / "out").exists()
    # somebody knows better
    assert unit_of(imported(tmp_path, capsys, log, numbers, unit=["wheel=m/s"]), "wheel")[0] == "m/s"


def test_a_wheel_of_another_time_has_the_unit_that_is_assumed(tmp_path: Path) -> None:
    """Nothing is compared, and that no reading falls into the fixes' time is what is said."""
    rows = [f"{BEGAN_S + 1000 + i},54.0" for i in range(SECONDS)]
    with pytest.raises(ConfigError, match="only 0 rows at the time of the fixes"):
        run_import(
            [fixes(tmp_path), beside(tmp_path, "wheel.csv", "timestamp,wheel_speed", rows)],
            None, tmp_path / "out", [], [], False, True,
        )  # fmt: skip


def test_numbers_that_no_train_reaches_are_left_out_of_a_wheel(tmp_path: Path, capsys) -> None:
    """Two cells of 99999 km/h once made a noise of 4.8 km/s."""
    said = imported(tmp_path, capsys, fixes(tmp_path), wheel(tmp_path, 54.0, "wheel_speed_kmh", odd=(100, 400)))
    assert "left out of wheel_speed_kmh: 2 rows beyond 200 m/s" in said["told"]
    recording = yaml.safe_load((tmp_path / "out/train.yaml").read_text())["units"]["odometer"]["recording"]
    assert recording["constants"]["speed_variance_m2ps2"] < 0.02
    copied = (tmp_path / "out" / recording["file"]).read_text().splitlines()[1:]
    assert {line.split(",")[1] for line in copied} == {"15"}


def test_a_gap_in_a_wheels_log_is_told(tmp_path: Path, capsys) -> None:
    """The clock of a logger that is set forward by 20 s looks the same."""
    rows = [f"{BEGAN_S + i / 10 + (20.0 if i > 200 else 0.0):.1f},15.0" for i in range(400)]
    said = imported(tmp_path, capsys, fixes(tmp_path), beside(tmp_path, "wheel.csv", "timestamp,wheel_speed_mps", rows))
    told = "the longest gap of wheel_speed_mps is of 20 s, after 20 s: there the device was silent, or its clock was set"
    assert told in said["told"]
    whole = imported(tmp_path / "b", capsys, fixes(tmp_path), wheel(tmp_path, 15.0, "wheel_speed_mps"))
    assert not [each for each in whole["told"] if "gap" in each]


def speed(t: float) -> float:
    """15 m/s, and ±2 m/s slowly."""
    return SPEED_MPS + 2.0 * math.sin(0.3 * t)


def changing_wheel(folder: Path) -> Path:
    """The speeds of a train that speeds up and slows down, ten times a second."""
    rows = [f"{BEGAN_S + i / 10:.1f},{speed(i / 10):.4f}" for i in range(10 * SECONDS + 1)]
    return beside(folder, "wheel.csv", "timestamp,wheel_speed_mps", rows)


def mounted(ahead: Sequence[float], right: Sequence[float], down: Sequence[float]) -> list[str]:
    """The rows of a unit that feels forward, right and down along these directions of its own x, y and z."""
    rows = []
    for i in range(20 * SECONDS):
        t = i / 20
        # force and turn rate: forward and right in a curve to the left, without gravity down
        felt, turns = (0.6 * math.cos(0.3 * t), -0.28, -G), (0.01, 0.002, -speed(t) / 800.0)
        axes = [
            sum(value * direction[at] for value, direction in zip(of, (ahead, right, down), strict=True))
            for of in (felt, turns)
            for at in range(3)
        ]
        rows.append(",".join([f"{BEGAN_S + t:.2f}", *(f"{value:.5f}" for value in axes)]))
    return rows


@pytest.mark.parametrize(
    ("ahead", "right", "down", "told"),
    [
        ((1, 0, 0), (0, 1, 0), (0, 0, 1), None),
        # its x to the right, so its y points back
        ((0, -1, 0), (1, 0, 0), (0, 0, 1), "forward is -ay_mps2, right is ax_mps2, down is az_mps2"),
        # upside down
        ((1, 0, 0), (0, -1, 0), (0, 0, -1), "forward is ax_mps2, right is -ay_mps2, down is -az_mps2"),
        # on a wall: y is down, z is ahead
        ((0, 0, 1), (1, 0, 0), (0, 1, 0), "forward is az_mps2, right is ax_mps2, down is ay_mps2"),
        # on a wall: x is up, z is to the left
        ((0, 1, 0), (0, 0, -1), (-1, 0, 0), "forward is ay_mps2, right is -az_mps2, down is -ax_mps2"),
    ],
)  # fmt: skip
def test_an_inertial_unit_is_turned_as_gravity_and_the_speed_show(ahead, right, down, told, tmp_path: Path, capsys) -> None:
    """Forward and down are found; that the third follows is seen by the force of the curve, -0.28 m/s² to the right."""
    logs = [
        fixes(tmp_path),
        changing_wheel(tmp_path),
        beside(tmp_path, "imu.csv", ",".join(["timestamp", *COLUMNS]), mounted(ahead, right, down)),
    ]
    said = imported(tmp_path, capsys, *logs)
    sentences = [each.partition(" is turned: ")[2] for each in said["told"] if "is turned" in each]
    assert sentences == ([] if told is None else [told])
    columns = yaml.safe_load((tmp_path / "out/train.yaml").read_text())["units"]["imu"]["recording"]["columns"]
    names = "xyz"
    for field, letter in (("specific_force_mps2", "a"), ("turn_rate_radps", "g")):
        for entry, direction in zip(columns[field], (ahead, right, down), strict=True):
            at = next(at for at in range(3) if direction[at])
            assert entry["column"].startswith(f"{letter}{names[at]}_")
            assert entry.get("scale", 1.0) == direction[at]


@pytest.mark.parametrize("askew_deg", [30.0, 45.0])
def test_an_inertial_unit_that_is_askew_is_left_out(askew_deg: float, tmp_path: Path, capsys) -> None:
    c, s = math.cos(math.radians(askew_deg)), math.sin(math.radians(askew_deg))
    rows = mounted((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0))
    logs = [
        fixes(tmp_path),
        changing_wheel(tmp_path),
        beside(tmp_path, "imu.csv", ",".join(["timestamp", *COLUMNS]), rows),
    ]
    (told,) = [each for each in imported(tmp_path, capsys, *logs)["told"] if "left out" in each]
    why = f"none of its axes points ahead: it is about {askew_deg:.0f} degrees askew"
    assert told == f"the inertial unit of imu.csv is left out: {why}"


def test_an_inertial_unit_of_which_no_axis_follows_the_speed_is_left_out(tmp_path: Path, capsys) -> None:
    still = [f"{BEGAN_S + i / 20:.2f},{0.1 * (i % 3)},{0.1 * (i % 5)},-9.81" for i in range(20 * SECONDS)]
    logs = [
        fixes(tmp_path),
        changing_wheel(tmp_path),
        beside(tmp_path, "imu.csv", "timestamp,ax_mps2,ay_mps2,az_mps2", still),
    ]
    (told,) = [each for each in imported(tmp_path, capsys, *logs)["told"] if "left out" in each]
    assert told.startswith("the inertial unit of imu.csv is left out: none of its axes follows the train's speed")
