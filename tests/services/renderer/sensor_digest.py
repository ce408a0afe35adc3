"""Prints a hash of lenses, interpolated poses and developed images, for comparison between CPUs."""

import hashlib
import sys

import numpy as np

from readygo.common.camera import CameraConfig
from readygo.common.camera.lens import make_lens
from readygo.common.images.light import light_of_byte
from readygo.common.messages import HumanMotion, Motion
from readygo.services.renderer import RendererConfig
from readygo.services.renderer.camera import TIME_ONE, arc, exposure_gain, make_shutter, sensor_rng
from readygo.services.renderer.config import sensor_phone_like
from readygo.services.renderer.faces import make_remap, plan_faces
from readygo.services.renderer.humans import pose_humans
from readygo.services.renderer.light import add_light, to_srgb

HEIGHT, WIDTH = 40, 64


def main() -> None:
    digest = hashlib.sha256(light_of_byte().tobytes())
    size = {"height_px": HEIGHT, "width_px": WIDTH}
    optics = {"distortion": "fisheye", "k1": 0.01, "vignetting": 0.2, "read_noise": 0.01, "shot_noise": 0.02}
    wide = CameraConfig(**size, horizontal_fov_deg=145.0, **optics), RendererConfig()
    for camera, config in (sensor_phone_like(CameraConfig(**size), RendererConfig()), wide):
        faces = plan_faces([make_lens(extreme) for extreme in config.sensor.extremes(camera)])
        key = (1, 2)
        drawn = config.sensor.draw_camera(camera, sensor_rng(key))
        lens = make_lens(drawn)
        remap = make_remap(lens, faces)
        shutter = make_shutter(drawn, config.sub_frames)
        words = np.random.Generator(np.random.Philox(key=np.array([5, 6], dtype=np.uint64)))
        shape = (len(remap.faces), faces.height_px, faces.width_px, 3)
        light = np.zeros((HEIGHT, WIDTH, 3), np.int64)
        for weight in shutter.weight:
            add_light(light, words.integers(0, 256, shape, dtype=np.uint8), remap, weight)
        image = to_srgb(light, drawn, exposure_gain(drawn), sensor_rng(key, 3))
        assert shutter.weight.sum() == TIME_ONE * HEIGHT
        for array in (faces.K_px, lens.K_px, remap.source, remap.weight, remap.depth_factor, shutter.weight, image):
            digest.update(array.tobytes())
    pose = np.random.default_rng(0).uniform(-2, 2, (2, 24, 3)).astype(np.float32)
    (between,) = pose_humans([HumanMotion(avatar="a", motion=Motion(root_m=pose[:, 0], pose_axis_angle=pose))], 0.3)
    digest.update(between.pose_axis_angle.tobytes() + between.root_m.tobytes())
    digest.update(np.array(arc(pose[0, 0].astype(float), pose[0, 1].astype(float), 0.7)).tobytes())
    sys.stdout.write(digest.hexdigest())


if __name__ == "__main__":
    main()
