"""The quality report of a scene: contents, provenance and likely defects."""
