"""Recorded data in the formats of other programs: how they are written, and how an export goes on after a stop."""
