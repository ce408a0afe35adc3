"""A capture simulator: a hand-held walk through a scene with a printed marker on its floor, and the truth about it."""
