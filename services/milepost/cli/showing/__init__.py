"""What a person sees of running trains: who has come, the live table."""
