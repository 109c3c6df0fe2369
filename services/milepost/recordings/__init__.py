"""Recordings: tables, units, column maps and log formats. Reading a file needs no simulator."""
