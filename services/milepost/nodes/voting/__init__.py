"""Two out of three: fusers that propose, the voter that publishes what two agree on, and the fault that it masks."""
