"""A position report in a line, for people."""

from __future__ import annotations

from milepost_schemas import PositionReport

from .position_report import NOMINAL, SCALES_M, STANDSTILL, SYSTEM_VERSION, UNKNOWN_LENGTH, UNKNOWN_LRBG

MODES = ("FS", "OS", "SR", "SH", "UN", "SL", "SB", "TR", "PT", "SF", "IS", "NL", "LS", "SN", "RV", "PS", "AD", "SM")
LEVELS = ("L0", "NTC", "L1", "L2")
SIDES = ("reverse", "nominal", "unknown")
NID_BG_BITS = 14
# system version 2 has no code of its own for it
STANDS = STANDSTILL[SYSTEM_VERSION]


def in_words(report: PositionReport) -> str:
    """Train, why it reported, where it is from which balise group, how fast, mode, level, and the packet."""
    speed = "stands" if report.v_train == STANDS else f"{5 * report.v_train} km/h {SIDES[report.q_dirtrain]}"
    level = LEVELS[report.m_level] + (f" {report.nid_ntc}" if report.nid_ntc is not None else "")
    words = f"{report.train} {report.trigger}: {_place(report)}, {speed}, {MODES[report.m_mode]} {level}"
    return f"{words}, {report.l_packet} bits {report.packet_hex}"


def _place(report: PositionReport) -> str:
    if report.nid_lrbg == UNKNOWN_LRBG:
        return "LRBG unknown"
    nid_c, nid_bg = divmod(report.nid_lrbg, 1 << NID_BG_BITS)
    side = "ahead of" if report.q_dlrbg == report.q_dirlrbg else "behind"
    distance, over, under = (_length(report, each) for each in (report.d_lrbg, report.l_doubtover, report.l_doubtunder))
    facing = "" if report.q_dirlrbg == NOMINAL else f", facing its {SIDES[report.q_dirlrbg]} direction"
    return f"{distance} (-{over} +{under}) {side} {nid_c}-{nid_bg}{facing}"


def _length(report: PositionReport, coded: int) -> str:
    return "unknown" if coded == UNKNOWN_LENGTH else f"{float(coded * SCALES_M[report.q_scale]):.1f} m"
