"""The position report of ERTMS/ETCS (SUBSET-026-7, packet 0), as variables and as bits."""

from __future__ import annotations

from typing import Annotated, ClassVar, Literal

from pydantic import Field, StringConstraints, model_validator

from .message import Count, Message

# why it was sent (SUBSET-026-3, 3.6.5.1.4 and 3.6.5.1.5)
Trigger = Literal["first", "time", "balise_group", "standstill_reached", "standstill_left"]
Length = Annotated[int, Field(ge=0, le=32767)]
# reverse, nominal, unknown
Side = Annotated[int, Field(ge=0, le=2)]


class PositionReport(Message):
    """Packet 0 for the state of `epoch`: its variables under their own names, coded as the standard says, and its bits.

    `packet_hex`: the `l_packet` bits of the packet, padded with zeros to whole bytes. Lengths are in steps of 10 cm,
    1 m or 10 m, by `q_scale` (0, 1, 2); 32767 is unknown or longer than 327.660 km. `nid_lrbg` 16777215: no balise group is
    known. `system_version` 3: as in issue 4.0.0; 2: as in issue 3.6.0, with 4 bits of `m_mode` and no code for standstill.
    """

    SCHEMA: ClassVar[str] = "position_report"

    epoch: Count
    trigger: Trigger
    system_version: Annotated[int, Field(ge=2, le=3)]
    l_packet: Annotated[int, Field(ge=0, le=8191)]
    q_scale: Annotated[int, Field(ge=0, le=2)]
    nid_lrbg: Annotated[int, Field(ge=0, le=16777215)]
    d_lrbg: Length
    q_dirlrbg: Side
    q_dlrbg: Side
    l_doubtover: Length
    l_doubtunder: Length
    q_integrity: Annotated[int, Field(ge=0, le=3)]
    l_trainint: Length | None = None
    v_train: Annotated[int, Field(ge=0, le=127)]
    q_dirtrain: Side
    m_mode: Annotated[int, Field(ge=0, le=17)]
    m_level: Annotated[int, Field(ge=0, le=3)]
    nid_ntc: Annotated[int, Field(ge=0, le=255)] | None = None
    packet_hex: Annotated[str, StringConstraints(pattern=r"^([0-9a-f]{2})+$")]

    @model_validator(mode="after")
    def _whole(self) -> PositionReport:
        if (self.l_trainint is not None) != (self.q_integrity in (1, 2)):
            raise ValueError("l_trainint stands where q_integrity is 1 or 2, and nowhere else")
        if (self.nid_ntc is not None) != (self.m_level == 1):
            raise ValueError("nid_ntc stands where m_level is 1, and nowhere else")
        if len(self.packet_hex) // 2 != -(-self.l_packet // 8):
            raise ValueError("packet_hex must have l_packet bits")
        if self.system_version == 2 and (self.m_mode > 15 or self.v_train > 120):
            raise ValueError("system version 2 has neither these modes nor a code for standstill")
        return self
