"""Cost of recording and reading, memory of a fleet."""
