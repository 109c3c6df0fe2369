"""Lines: chainage, balises, profile and geometry on the earth. The lowest room: it knows nothing of trains."""
