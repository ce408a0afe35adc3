"""A run: its settings, folder, world and stages; replay of a single episode (`take`)."""
