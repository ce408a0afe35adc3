"""A run: its settings, folder, world and stages."""
