"""Milepost: tells a train where it is and how fast it goes, with an honest bound on the error."""
