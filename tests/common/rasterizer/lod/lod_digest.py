"""Prints a hash of the trees above a cloud and an avatar; run by a test under different instruction sets."""

import hashlib

from readygo.common.rasterizer.lod.avatar import build_avatar_tree
from readygo.common.rasterizer.lod.tree import build_tree
from readygo.common.rasterizer.packed.avatar import pack_avatar
from readygo.common.rasterizer.packed.scene import pack_cloud
from tests.common.rasterizer.cpu.frames_digest import avatar, cloud
from tests.common.rasterizer.lod.lod_scenes import room

if __name__ == "__main__":
    digest = hashlib.sha256()
    trees = [build_tree(pack_cloud(room(20000), normals=True)), build_tree(pack_cloud(cloud(3000, 16, 5.0)))]
    humans = build_avatar_tree(pack_avatar(avatar()))
    for tree in (*trees, humans):
        scene = humans.avatar.scene if tree is humans else tree.scene
        for array in (tree.skip, tree.pixel_m, scene.centre_m, scene.reach_m, scene.geometry, scene.colour, scene.sh):
            digest.update(array.tobytes())
    digest.update(humans.avatar.weight.tobytes())
    print(digest.hexdigest())  # noqa: T201
