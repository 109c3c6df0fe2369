"""THE TABLE OF FUSION RULES: how the fuser makes one state of estimates and fixes."""

from __future__ import annotations

from .federated.rule import FederatedFusion
from .information_rule import InformationFusion

RULES: dict[str, type[InformationFusion] | type[FederatedFusion]] = {
    "information": InformationFusion,
    "federated": FederatedFusion,
}
