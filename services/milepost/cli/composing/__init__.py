"""`milepost compose`: a train as containers."""
