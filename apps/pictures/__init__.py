"""Videos, overlays and pictures of recorded episodes, planned ones (`plan_film`), labels, scenes and their maps."""
