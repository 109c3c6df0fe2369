"""The nodes without Zenoh: a memory bus, runs of whole trains on it, and reruns of recorded messages."""
