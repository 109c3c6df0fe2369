"""The position report of ERTMS/ETCS: bits computed by hand from SUBSET-026-7, issue 4.0.0, and intervals that only grow."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from examples import EXAMPLES, T0, head, write_train
from milepost.config.etcs_file import balise_groups
from milepost.config.line_file import load_line
from milepost.config.shipped_files import find_file
from milepost.config.train import load_train
from milepost.config.yaml_files import ConfigError
from milepost.feeds.position_report import (
    LONGEST,
    NOMINAL,
    REVERSE,
    UNKNOWN,
    UNKNOWN_LENGTH,
    UNKNOWN_LRBG,
    VARIABLES,
    BaliseGroup,
    OnBoard,
    packed,
    position_report,
    unpacked,
)
from milepost.nodes.position_report import PositionReportNode
from milepost_schemas import FusedState, PositionReport

# NID_C 352, NID_BG 1001: 0101100000 00001111101001
GROUP = BaliseGroup(352 << 14 | 1001, 1000.0)
FULL = OnBoard(mode=0, level=3)


def state(position_m: float, least_m: float, most_m: float, speed_mps: float = 25.0, **changed: Any) -> FusedState:
    direction = "standstill" if speed_mps == 0.0 else "forward" if speed_mps > 0.0 else "backward"
    fields = {
        **EXAMPLES["state"][0].model_dump(),
        **head("fuser"),
        "position_m": position_m,
        "position_min_m": least_m,
        "position_max_m": most_m,
        "speed_mps": speed_mps,
        "speed_min_mps": speed_mps - 1.0,
        "speed_max_mps": speed_mps + 1.0,
        "direction": direction,
        "settled": False,
        "last_balise": None,
    }
    return FusedState.model_validate({**fields, **changed})


def bits(text: str) -> bytes:
    """Bytes of written-out bits, padded with zeros."""
    digits = "".join(text.split())
    digits += "0" * (-len(digits) % 8)
    return int(digits, 2).to_bytes(len(digits) // 8, "big")


def test_a_report_by_hand() -> None:
    """123.5 m beyond a group that was passed in its nominal direction, between 120.25 and 125 m, at 90 km/h, FS, level 2."""
    found = position_report(state(1123.5, 1120.25, 1125.0), GROUP, FULL)
    assert found == {
        "nid_packet": 0,
        "l_packet": 115,
        "q_scale": 0,
        "nid_lrbg": 5768169,
        "d_lrbg": 1235,
        "q_dirlrbg": 1,
        "q_dlrbg": 1,
        "l_doubtover": 33,  # 3.25 m, outwards
        "l_doubtunder": 15,
        "q_integrity": 0,
        "v_train": 18,
        "q_dirtrain": 1,
        "m_mode": 0,
        "m_level": 3,
    }
    # NID_PACKET, L_PACKET, Q_SCALE, NID_C and NID_BG, D_LRBG, Q_DIRLRBG, Q_DLRBG, L_DOUBTOVER, L_DOUBTUNDER, Q_INTEGRITY,
    # V_TRAIN, Q_DIRTRAIN, M_MODE, M_LEVEL
    assert packed(found) == bits(
        "00000000 0000001110011 00 0101100000 00001111101001 000010011010011 01 01 000000000100001 000000000001111 00"
        " 0010010 01 00000 011"
    )


def test_a_report_with_integrity_and_a_national_system_by_hand() -> None:
    """In the rear of a group, against chainage, at standstill, on sight, in level NTC 6, with 200.5 m of confirmed length."""
    train = OnBoard(mode=1, level=1, nid_ntc=6, reverse=True, integrity=2, trainint_m=200.5)
    found = position_report(state(1000.5, 999.0, 1003.0, speed_mps=0.0), GROUP, train)
    # the active cab looks to lower chainage: the group is 0.5 m ahead of the front end
    assert found == {
        "nid_packet": 0,
        "l_packet": 115 + 15 + 8,
        "q_scale": 0,
        "nid_lrbg": 5768169,
        "d_lrbg": 5,
        "q_dirlrbg": REVERSE,
        "q_dlrbg": NOMINAL,
        "l_doubtover": 25,  # to 1003
        "l_doubtunder": 15,  # to 999
        "q_integrity": 2,
        "l_trainint": 201,
        "v_train": 127,
        "q_dirtrain": UNKNOWN,
        "m_mode": 1,
        "m_level": 1,
        "nid_ntc": 6,
    }
    assert packed(found) == bits(
        "00000000 0000010001010 00 0101100000 00001111101001 000000000000101 00 01 000000000011001 000000000001111 10"
        " 000000011001001 1111111 10 00001 001 00000110"
    )


def test_a_report_of_system_version_2_has_four_bits_of_mode_and_no_code_for_standstill() -> None:
    """In stand by and level NTC 6: 122 bits, as such reports have in service."""
    train = OnBoard(mode=6, level=1, nid_ntc=6, system_version=2)
    group = BaliseGroup(1221807, 1000.0)
    found = position_report(state(853.8, 839.91, 868.89, speed_mps=0.0), group, train)
    assert found["l_packet"] == 122
    assert (found["d_lrbg"], found["q_dlrbg"], found["l_doubtover"], found["l_doubtunder"]) == (1462, 0, 139, 151)
    assert (found["v_train"], found["q_dirtrain"]) == (0, 2)
    assert packed(found, 2) == bits(
        "00000000 0000001111010 00 000100101010010010101111 000010110110110 01 00 000000010001011 000000010010111 00"
        " 0000000 10 0110 001 00000110"
    )
    assert unpacked(packed(found, 2), 2) == found


def test_without_a_balise_group_all_that_refers_to_one_is_unknown() -> None:
    found = position_report(state(1123.5, 1120.0, 1125.0), None, FULL)
    assert found["nid_lrbg"] == UNKNOWN_LRBG == 2**24 - 1
    assert found["d_lrbg"] == found["l_doubtover"] == found["l_doubtunder"] == UNKNOWN_LENGTH == 2**15 - 1
    assert found["q_dirlrbg"] == found["q_dlrbg"] == found["q_dirtrain"] == UNKNOWN
    assert found["v_train"] == 18


@pytest.mark.parametrize(
    ("distance_m", "scale", "coded"),
    [
        (3276.6, 0, 32766),
        (3276.7, 1, 3277),
        (32766.0, 1, 32766),
        (32767.0, 2, 3277),
        (327_660.0, 2, 32766),
        (327_670.0, 2, 32767),
    ],
)
def test_the_finest_scale_is_used_in_which_all_lengths_can_be_said(distance_m: float, scale: int, coded: int) -> None:
    at_m = 1000.0 + distance_m
    found = position_report(state(at_m, at_m, at_m), GROUP, FULL)
    assert (found["q_scale"], found["d_lrbg"]) == (scale, coded)


def test_a_wide_interval_makes_the_scale_coarse_and_beyond_that_unknown() -> None:
    found = position_report(state(1100.0, -5000.0, 401_100.0), GROUP, FULL)
    assert found["q_scale"] == 2
    assert (found["d_lrbg"], found["l_doubtover"], found["l_doubtunder"]) == (10, 610, UNKNOWN_LENGTH)


@pytest.mark.parametrize(
    ("kmh", "coded"), [(0.0, 127), (0.5, 0), (4.9, 0), (5.0, 1), (36.0, 7), (90.0, 18), (600.0, 120), (700.0, 120), (-90.0, 18)]
)
def test_speed_is_in_whole_steps_and_standstill_is_its_own_code(kmh: float, coded: int) -> None:
    # a little more, because kilometres an hour are no floats in metres a second
    speed_mps = kmh / 3.6 * (1.0 + 1e-12)
    assert position_report(state(1100.0, 1099.0, 1101.0, speed_mps), GROUP, FULL)["v_train"] == coded


@pytest.mark.parametrize("cab_back", [False, True])
@pytest.mark.parametrize("group_back", [False, True])
@pytest.mark.parametrize("beyond", [False, True])
@pytest.mark.parametrize("forward", [False, True])
def test_directions_are_those_of_the_balise_group(cab_back: bool, group_back: bool, beyond: bool, forward: bool) -> None:
    group, train = BaliseGroup(1, 1000.0, group_back), OnBoard(0, 3, reverse=cab_back)
    at_m = 1100.0 if beyond else 900.0
    found = position_report(state(at_m, at_m, at_m, 20.0 if forward else -20.0), group, train)
    assert found["q_dirlrbg"] == (NOMINAL if cab_back == group_back else REVERSE)
    assert found["q_dlrbg"] == (NOMINAL if beyond != group_back else REVERSE)
    assert found["q_dirtrain"] == (NOMINAL if forward != group_back else REVERSE)
    assert found["d_lrbg"] == 1000


def test_the_front_end_is_ahead_of_the_reference_point() -> None:
    for reverse, at_m in ((False, 1010.0), (True, 990.0)):
        found = position_report(state(at_m, at_m, at_m), GROUP, OnBoard(0, 3, front_m=2.5, reverse=reverse))
        assert found["d_lrbg"] == 125


metres = st.floats(-400_000.0, 400_000.0)


@given(
    at_m=metres, over_m=st.floats(0.0, 5000.0), under_m=st.floats(0.0, 5000.0), place_m=st.floats(0.0, 1e5), back=st.booleans()
)
def test_the_coded_interval_holds_the_published_one(at_m, over_m, under_m, place_m, back) -> None:
    train, group = OnBoard(0, 3, reverse=back), BaliseGroup(1, place_m)
    least_m, most_m = at_m - over_m, at_m + under_m
    found = position_report(state(at_m, least_m, most_m), group, train)
    if UNKNOWN_LENGTH in (found["d_lrbg"], found["l_doubtover"], found["l_doubtunder"]):
        assert max(abs(at_m - place_m), over_m, under_m) > 327_660.0 - 5.0
        return
    step_m = (0.1, 1.0, 10.0)[found["q_scale"]]
    # seen from the group in the direction of chainage
    side = 1.0 if found["q_dlrbg"] == NOMINAL else -1.0
    coded_m = side * found["d_lrbg"] * step_m
    ends = sorted((-found["l_doubtover"] * step_m, found["l_doubtunder"] * step_m) if not back else
                  (-found["l_doubtunder"] * step_m, found["l_doubtover"] * step_m))  # fmt: skip
    assert abs(coded_m - (at_m - place_m)) <= 0.5 * step_m + 1e-9
    assert coded_m + ends[0] <= least_m - place_m + 1e-9
    assert coded_m + ends[1] >= most_m - place_m - 1e-9
    # and by no more than two steps
    assert coded_m + ends[0] >= least_m - place_m - 2.0 * step_m
    assert coded_m + ends[1] <= most_m - place_m + 2.0 * step_m
    assert max(found["d_lrbg"], found["l_doubtover"], found["l_doubtunder"]) <= LONGEST


@st.composite
def packets(draw: st.DrawFn) -> dict[str, int]:
    found = {name: draw(st.integers(0, (1 << size) - 1)) for name, size in VARIABLES}
    found["nid_packet"] = 0
    if found["q_integrity"] not in (1, 2):
        del found["l_trainint"]
    if found["m_level"] != 1:
        del found["nid_ntc"]
    found["l_packet"] = sum(size for name, size in VARIABLES if name in found)
    return found


@given(packets())
def test_a_packet_that_is_read_is_what_was_written(found: dict[str, int]) -> None:
    assert unpacked(packed(found)) == found


@given(st.binary(max_size=24))
def test_bytes_that_are_no_packet_are_refused(packet: bytes) -> None:
    try:
        found = unpacked(packet)
    except ValueError:
        return
    assert packed(found)[: len(packet) - 1] == packet[:-1]


def test_a_value_that_is_too_large_is_refused() -> None:
    with pytest.raises(ValueError, match="v_train: 128 has more than 7 bits"):
        packed({"nid_packet": 0, "v_train": 128})


NS = 1_000_000_000
LINE = load_line(find_file(Path("regional"), "lines"))


def node() -> PositionReportNode:
    return PositionReportNode("regional-1", "a1", balise_groups(LINE), FULL, NS)


def seen(at_s: float, balise: str | None = None, speed_mps: float = 20.0) -> FusedState:
    at_ns = T0 + round(at_s * NS)
    passed = balise and {"balise_id": balise, "position_m": 400.0, "distance_since_m": 1.0}
    return state(500.0, 499.0, 501.0, speed_mps, measured_at_ns=at_ns, last_balise=passed)


def reports(*states: FusedState) -> list[tuple[float, str, int]]:
    """When, why and by which balise group was reported."""
    each = node()
    out = [output.message for one in states for output in each.step(one, one.measured_at_ns + 1000)]
    assert all(isinstance(report, PositionReport) for report in out)
    assert [report.sequence for report in out] == list(range(len(out)))
    return [((r.measured_at_ns - T0) / NS, r.trigger, r.nid_lrbg & 0x3FFF) for r in out]


def test_reports_come_first_then_every_second() -> None:
    assert reports(*(seen(i * 0.25) for i in range(9))) == [(0.0, "first", 16383), (1.0, "time", 16383), (2.0, "time", 16383)]


def test_a_balise_group_is_reported_at_once_and_one_without_identity_is_no_reference() -> None:
    found = reports(seen(0.0), seen(0.25, "b00001"), seen(0.5, "b00001"), seen(0.75, "unlinked"), seen(1.0, "b00002"))
    assert found == [(0.0, "first", 16383), (0.25, "balise_group", 1001), (1.0, "balise_group", 1002)]


def test_a_stop_and_a_start_are_reported_at_once() -> None:
    found = reports(seen(0.0), seen(0.25, speed_mps=0.0), seen(0.75, speed_mps=0.0), seen(1.3))
    assert [(at, why) for at, why, _ in found] == [(0.0, "first"), (0.25, "standstill_reached"), (1.3, "standstill_left")]


def test_a_train_that_crawls_at_the_threshold_reports_no_more_than_twice_a_period() -> None:
    found = reports(*(seen(i * 0.02, speed_mps=0.06 if i % 2 else 0.0) for i in range(500)))
    assert len(found) <= 20


def test_a_second_state_of_an_epoch_is_not_reported() -> None:
    assert len(reports(seen(0.0), seen(0.0), seen(2.0), seen(1.0))) == 2


def test_a_report_carries_its_packet() -> None:
    one = seen(0.0, "b00001")
    (output,) = node().step(one, one.measured_at_ns)
    report = output.message
    assert isinstance(report, PositionReport)
    found = unpacked(bytes.fromhex(report.packet_hex))
    assert found.pop("nid_packet") == 0
    assert found == {name: getattr(report, name) for name in found}
    assert (report.d_lrbg, report.l_doubtover, report.l_doubtunder) == (1000, 10, 10)


def test_the_shipped_line_numbers_its_balise_groups() -> None:
    groups = balise_groups(LINE)
    assert groups["b00001"] == BaliseGroup(352 << 14 | 1001, 400.0)
    assert len(groups) == len(LINE.balises) == 38


ETCS = {"mode": "full_supervision", "level": "2"}
ROWS = [{"id": "a", "position_m": 10.0, "nid_bg": 5}, {"id": "b", "position_m": 20.0, "nid_bg": 5}]


@pytest.mark.parametrize(
    ("train", "line", "text"),
    [
        ({"etcs": ETCS}, {}, "etcs: needs balises with an identity"),
        ({"etcs": {**ETCS, "mode": "full"}}, {}, "etcs.mode: must be one of full_supervision, "),
        ({"etcs": {**ETCS, "level": "3"}}, {}, "etcs.level: must be one of 0, ntc, 1, 2, not '3'"),
        ({"etcs": {**ETCS, "level": "ntc"}}, {}, "etcs: nid_ntc: is for level `ntc`, and is required there"),
        ({"etcs": {**ETCS, "nid_ntc": 6}}, {}, "etcs: nid_ntc: is for level `ntc`, and is required there"),
        ({"etcs": {**ETCS, "mode": "automatic_driving", "system_version": 2}}, {}, "etcs: mode: automatic_driving needs "),
        ({}, {"balises": [ROWS[0]]}, "nid_c: required where balises have a `nid_bg`"),
        ({}, {"balises": ROWS, "nid_c": 1}, "balises.1.nid_bg: duplicate balise group 5"),
        ({}, {"balises": {"every_m": 10.0, "nid_bg_from": 16380}, "nid_c": 1}, "balises.nid_bg_from: the last of "),
        ({}, {"nid_c": 1024}, "nid_c: Input should be less than or equal to 1023"),
    ],
)
def test_a_mistake_names_file_and_field(tmp_path: Path, train: Any, line: Any, text: str) -> None:
    with pytest.raises(ConfigError) as caught:
        load_train(write_train(tmp_path, train, line))
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)
