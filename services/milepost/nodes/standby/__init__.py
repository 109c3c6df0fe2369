"""Several fusers of a train, one of which speaks."""
