"""Estimators compared offline: scenarios run on the memory bus, scored against the truth where there is one, reported."""
