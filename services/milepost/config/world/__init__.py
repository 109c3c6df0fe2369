"""The world of a simulated train as a train file describes it: how it moves, where its wheels slip."""
