"""Whole trains in one process of the operating system, on one session: for small computers and for fleets."""
