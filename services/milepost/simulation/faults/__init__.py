"""Faults: of the links between processes, and of what a unit's sensor sends."""

from .effect import FaultKind, Sent, Surroundings
from .entry import FaultEntry, not_an_option, reason_of
from .injection import Injection
from .link import Fault, Link, delayed, silent
from .table import FAULTS

__all__ = [
    "FAULTS",
    "Fault",
    "FaultEntry",
    "FaultKind",
    "Injection",
    "Link",
    "Sent",
    "Surroundings",
    "delayed",
    "not_an_option",
    "reason_of",
    "silent",
]
