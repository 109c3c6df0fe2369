"""How a process that was restarted catches up from the others of its train."""
