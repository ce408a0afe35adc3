"""Policies on robots: what a robot sends, what it is told, and a robot to try it with."""
