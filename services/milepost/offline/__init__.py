"""The same nodes without Zenoh: a memory bus, whole trains on it, runs recorded and run again."""
