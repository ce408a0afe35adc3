"""A run: its settings, folder, world and stages; a single episode of it, taken again (`take`)."""
