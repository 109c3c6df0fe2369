"""Estimators compared offline: scenarios run on the memory bus, scored against the truth, reported."""
