"""What has come to a process: how it waits, what is let in, what is in it."""
