"""Pictures and films: maps from above with what happened on them, PNG and MP4 files."""
