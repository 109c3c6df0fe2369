"""How a restarted fuser catches up from another one of the train."""
