"""The demo: the main job on the embedded scene, with a report and a video."""
