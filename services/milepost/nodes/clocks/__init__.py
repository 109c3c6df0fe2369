"""Whether a process's clock is right, and a node that does not see where it is not."""
