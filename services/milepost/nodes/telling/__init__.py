"""What the fuser says of its state: the published message, and its decisions as events."""
