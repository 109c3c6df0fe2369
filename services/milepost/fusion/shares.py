"""THE TABLE OF SHARES: how the information-sharing factors β are chosen. Always Σβ = 1 over the reporting units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar, Protocol

from .federated.combination import share_out


class Shares(Protocol):
    """β of the reporting units at a speed (m/s); `information` J of each unit's recent observations has no unit.

    `by_information`: β depends on J, which costs time with every observation. `follows_state`: β depends on speed or J, and
    is computed again once the state is known.
    """

    by_information: ClassVar[bool]
    follows_state: ClassVar[bool]

    def at(self, reporting: Sequence[str], speed_mps: float, information: Mapping[str, float]) -> dict[str, float]: ...


@dataclass(frozen=True)
class FixedShares:
    """The train file's β for each unit; a silent unit's goes to the others in proportion. Source: A (14)."""

    by_information: ClassVar[bool] = False
    follows_state: ClassVar[bool] = False
    table: Mapping[str, float]

    def at(self, reporting: Sequence[str], speed_mps: float, information: Mapping[str, float]) -> dict[str, float]:  # noqa: ARG002
        """The same at every speed."""
        return share_out(self.table, reporting)


@dataclass(frozen=True)
class SpeedRow:
    """The shares below a speed (m/s; infinite in the last row)."""

    below_mps: float
    shares: Mapping[str, float]


@dataclass(frozen=True)
class SharesBySpeed:
    """β from a table over speed ranges: below 50 km/h, 50 to 150, above, in source B. A silent unit's goes to the others."""

    by_information: ClassVar[bool] = False
    follows_state: ClassVar[bool] = True
    rows: tuple[SpeedRow, ...]

    def at(self, reporting: Sequence[str], speed_mps: float, information: Mapping[str, float]) -> dict[str, float]:  # noqa: ARG002
        """The row of the speed's range, in either direction of travel."""
        row = next((r for r in self.rows if abs(speed_mps) < r.below_mps), self.rows[-1])
        return share_out(row.shares, reporting)


@dataclass(frozen=True)
class SharesByAccuracy:
    """β in proportion to the information of each unit's recent observations, J_i = Σ h P hᵀ/R.

    h P hᵀ/R is the predicted variance over the reading's own, so that positions and speeds can be added; P is the fused
    covariance. Source: B, "by their accuracy at the present speed".
    """

    by_information: ClassVar[bool] = True
    follows_state: ClassVar[bool] = True

    def at(self, reporting: Sequence[str], speed_mps: float, information: Mapping[str, float]) -> dict[str, float]:  # noqa: ARG002
        """The shares in proportion to J."""
        return share_out(information, reporting)
