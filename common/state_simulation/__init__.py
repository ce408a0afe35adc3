"""Many robots at once in the project's episodes, compiled: the rules of `EpisodeSimulation` without its objects.

Robots know the map and their pose. People are told by a tracker, from simulated detections of those in view.
"""
