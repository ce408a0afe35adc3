"""Metres, up and the floor."""
