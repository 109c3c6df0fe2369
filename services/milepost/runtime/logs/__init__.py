"""What processes say beside what they publish."""
