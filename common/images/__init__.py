"""The images of a view, and their files."""
