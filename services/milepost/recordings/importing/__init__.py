"""A log of somebody's own, of whatever shape: what its columns are, and its rows as sources of readings."""
