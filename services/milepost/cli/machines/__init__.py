"""Commands for machines that read: feeds over HTTP, position reports, the table of events."""
