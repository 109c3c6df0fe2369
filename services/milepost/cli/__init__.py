"""What a person types. One file for each command."""
