"""The section `etcs` of train files: what a position report says of the train and Milepost does not know."""

from __future__ import annotations

from typing import Annotated, Literal, get_args

from pydantic import BaseModel, Field, model_validator

from milepost.feeds.position_report import LEVEL_NTC, SYSTEM_VERSION, BaliseGroup, OnBoard
from milepost.recordings.options import STRICT
from milepost.track.line import Line

# SUBSET-026-7, 7.5.1.72 and 7.5.1.65; the place in the list is the code
Mode = Literal[
    "full_supervision",
    "on_sight",
    "staff_responsible",
    "shunting",
    "unfitted",
    "sleeping",
    "stand_by",
    "trip",
    "post_trip",
    "system_failure",
    "isolation",
    "non_leading",
    "limited_supervision",
    "national_system",
    "reversing",
    "passive_shunting",
    "automatic_driving",
    "supervised_manoeuvre",
]
Level = Literal["0", "ntc", "1", "2"]


class EtcsFile(BaseModel):
    """Position reports of ERTMS/ETCS are sent every `every_s`, at balise groups and at stops.

    `mode` and `level` are said as they stand here; `nid_ntc` is the national system in level `ntc`. The front end lies
    `front_m` ahead of the reference point, in the direction of the active `cab`: `forward` is towards higher chainage.
    `system_version` is the trackside's.
    """

    model_config = STRICT
    mode: Mode
    level: Level
    nid_ntc: Annotated[int, Field(ge=0, le=255)] | None = None
    cab: Literal["forward", "backward"] = "forward"
    front_m: Annotated[float, Field(ge=0.0, le=1000.0)] = 0.0
    system_version: Annotated[int, Field(ge=2, le=3)] = SYSTEM_VERSION
    every_s: Annotated[float, Field(ge=0.1, le=255.0)] = 1.0

    @model_validator(mode="after")
    def _known(self) -> EtcsFile:
        if (self.nid_ntc is not None) != (self.level == "ntc"):
            raise ValueError("nid_ntc: is for level `ntc`, and is required there")
        if self.system_version == 2 and self.mode in ("automatic_driving", "supervised_manoeuvre"):
            raise ValueError(f"mode: {self.mode} needs `system_version: 3`")
        return self

    @property
    def on_board(self) -> OnBoard:
        """The same, coded."""
        mode, level = get_args(Mode).index(self.mode), get_args(Level).index(self.level)
        nid_ntc = self.nid_ntc if level == LEVEL_NTC else None
        return OnBoard(mode, level, nid_ntc, self.front_m, self.cab == "backward", system_version=self.system_version)


def balise_groups(line: Line) -> dict[str, BaliseGroup]:
    """The balises of a line that have an identity, by name."""
    return {b.balise_id: BaliseGroup(b.nid_lrbg, b.position_m, b.reverse) for b in line.balises if b.nid_lrbg is not None}
