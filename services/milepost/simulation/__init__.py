"""The train that is not there: its motion is a pure function of time, so that every process can evaluate it alone."""
