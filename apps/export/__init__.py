"""Recorded data in the formats of other programs: who reads what, how it is written, and how it goes on after a stop."""
