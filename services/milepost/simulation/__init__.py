"""The simulated train: its motion is a pure function of time, so that every process can evaluate it alone."""
