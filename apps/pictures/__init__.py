"""Films, overlays and pictures: recorded episodes, planned ones (`plan_film`), labels, scenes and their maps."""
