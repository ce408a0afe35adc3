"""Policies that are told states instead of images: their artifact, and their drivers."""
