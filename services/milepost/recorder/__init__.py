"""Recordings of what a train's processes sent: MCAP files written, read, described and exported. Knows no Zenoh."""
