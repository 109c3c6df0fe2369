"""Campaigns: every fault on every unit of trains, on many seeds; how the published interval and the exclusion held."""
