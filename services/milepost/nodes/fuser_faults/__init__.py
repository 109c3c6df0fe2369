"""Faults of a fuser, on command: of its memory, and of its clock."""
