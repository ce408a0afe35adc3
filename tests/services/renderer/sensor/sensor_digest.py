"""Prints a hash of lenses, interpolated poses and developed images, for comparison between CPUs."""

import hashlib
import sys

import numpy as np

from readygo.common.messages import HumanMotion, Motion
from readygo.common.robot import CameraConfig
from readygo.services.renderer.sensor.config import SensorConfig, sensor_phone_like
from readygo.services.renderer.sensor.faces import make_remap, plan_faces
from readygo.services.renderer.sensor.lens import make_lens
from readygo.services.renderer.sensor.light import TIME_ONE, LightSum, exposure_gain, light_of_byte
from readygo.services.renderer.sensor.motion import arc, posed
from readygo.services.renderer.sensor.shutter import make_shutter
from readygo.services.renderer.sensor.streams import SensorStream

HEIGHT, WIDTH = 40, 64


def main() -> None:
    digest = hashlib.sha256(light_of_byte().tobytes())
    wide = SensorConfig(distortion="fisheye", k1=0.01, vignetting=0.2, read_noise=0.01, shot_noise=0.02)
    for sensor, fov_deg in ((sensor_phone_like(), 100.0), (wide, 145.0)):
        camera = CameraConfig(height_px=HEIGHT, width_px=WIDTH, horizontal_fov_deg=fov_deg)
        faces = plan_faces([make_lens(extreme, camera) for extreme in sensor.extremes()])
        stream = SensorStream((1, 2))
        drawn = sensor.drawn(stream.of_draws())
        lens = make_lens(drawn, camera)
        remap = make_remap(lens, faces)
        shutter = make_shutter(drawn, HEIGHT)
        words = np.random.Generator(np.random.Philox(key=np.array([5, 6], dtype=np.uint64)))
        shape = (len(remap.faces), faces.height_px, faces.width_px, 3)
        light = LightSum(HEIGHT, WIDTH)
        for weight in shutter.weight:
            light.add(words.integers(0, 256, shape, dtype=np.uint8), remap, weight)
        image = light.developed(drawn, exposure_gain(drawn, HEIGHT, WIDTH), stream.of_frame(3))
        assert shutter.weight.sum() == TIME_ONE * HEIGHT
        for array in (faces.K_px, lens.K_px, remap.source, remap.weight, remap.depth_factor, shutter.weight, image):
            digest.update(array.tobytes())
    pose = np.random.default_rng(0).uniform(-2, 2, (2, 24, 3)).astype(np.float32)
    (between,) = posed([HumanMotion(avatar="a", motion=Motion(root_m=pose[:, 0], pose_axis_angle=pose))], 0.3)
    digest.update(between.pose_axis_angle.tobytes() + between.root_m.tobytes())
    digest.update(np.array(arc(pose[0, 0].astype(float), pose[0, 1].astype(float), 0.7)).tobytes())
    sys.stdout.write(digest.hexdigest())


if __name__ == "__main__":
    main()
