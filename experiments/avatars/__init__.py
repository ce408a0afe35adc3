"""Measures of extracted avatars."""
