"""Avatars of people who were filmed: from images, masks, cameras and body poses to an avatar file.

    from readygo.services.reconstructor.avatars.footage import read_footage  # the film of a person
    from readygo.services.reconstructor.avatars.extract import extract_avatar  # the avatar, its measures and its report

Gaussians start on the surface of the embedded body that fits the silhouettes best, with its skinning weights. Stature,
lengths of bones, the pose of every frame and the Gaussians are then found together, by how the drawn person differs
from the filmed one.
"""
