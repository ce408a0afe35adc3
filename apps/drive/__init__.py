"""Policies on robots: messages from and to a robot, and a simulated robot for tests."""
