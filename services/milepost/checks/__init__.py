"""What the field's requirements ask of published positions and speeds, checked against the truth."""
