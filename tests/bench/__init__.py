"""`make bench`: what things cost, as ratios in one run, beside peers and the raw transport."""
