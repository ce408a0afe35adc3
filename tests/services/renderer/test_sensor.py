import math
from dataclasses import fields, replace
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import cv2
import numpy as np
import pytest

from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.camera.lens import make_lens
from readygo.common.errors import ConfigError
from readygo.common.images.images import OUTPUTS, Images
from readygo.common.images.light import byte_of_light, light_of_byte
from readygo.common.maps import FloorMap, GridFrame, OccupancyMap
from readygo.common.messages import (
    EpisodeKey,
    EpisodeMotions,
    HumanMotion,
    Humans,
    RenderRequest,
    RenderView,
    Split,
)
from readygo.common.robot import RobotConfig, step_unicycle
from readygo.common.scenes import Scene
from readygo.services.renderer import Renderer, RendererConfig, Shot, episode_header, episode_samples
from readygo.services.renderer import renderer as renderer_module
from readygo.services.renderer.config import sensor_phone_like
from readygo.services.renderer.handlers import handle_render
from tests.services.renderer.pictures import drawn, taken
from tests.services.renderer.wearers import wearers

CAMERA = CameraConfig(height_px=96, width_px=160)
TURN_RADPS = 1.2
DARK = 0.05
"""Light of the world where it is not bright."""


class PosterWorld:
    """A world at infinity, as bright (0 to 1) as azimuth and elevation say; keeps the sizes of its batches."""

    def __init__(self, pinhole, bright, views_at_once: int = 1) -> None:
        self.pinhole, self.bright, self.views_at_once, self.batches = pinhole, bright, views_at_once, []

    def render(self, views, outputs=("rgb",)) -> Images:
        self.batches.append(len(views))
        images = [self._image(view.T_world_camera) for view in views]
        return Images(**{name: np.stack([one.arrays()[name] for one in images]) for name in images[0].arrays()})

    def _image(self, T_world_camera) -> Images:
        p = self.pinhole
        u, v = np.meshgrid(np.arange(p.width_px) + 0.5, np.arange(p.height_px) + 0.5)
        K = p.K_px
        rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u)], axis=-1)
        world = rays @ T_world_camera[:3, :3].T
        azimuth = np.arctan2(world[..., 1], world[..., 0])
        elevation = np.arctan2(world[..., 2], np.hypot(world[..., 0], world[..., 1]))
        bright = self.bright(azimuth, elevation)
        grey = byte_of_light()[np.rint((DARK + (1.0 - DARK) * bright) * 65535).astype(int)]
        rgb = np.repeat(grey[..., None], 3, axis=-1)
        near = np.full(u.shape, 2.0, dtype=np.float32)
        mask = (bright > 0.5).astype(np.uint8)
        normal = -rays / np.linalg.norm(rays, axis=-1, keepdims=True)
        # Walls 2 m away along the optical axis of whichever camera looks.
        return Images(rgb=rgb, depth_m=near, mask=mask, alpha=np.ones_like(near), normal=normal.astype(np.float32))


def capture(camera: CameraConfig, bright, sub_frames: int = 8, views_at_once: int = 1) -> Renderer:
    frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=1.0)
    free = OccupancyMap(frame=frame, occupied=np.zeros((2, 2), np.bool_))
    scene = Scene(name="poster", path=Path(), content_hash="", metadata={"files": {}})
    scene.__dict__["maps"] = SimpleNamespace(floor=FloorMap(frame=frame, height_m=np.zeros((2, 2), "f4")), robot=free)

    def make_poster(backend, clouds, avatars, pinhole, **_) -> PosterWorld:
        return PosterWorld(pinhole, bright, views_at_once)

    with patch.object(renderer_module, "make_rasterizer", make_poster):
        config = RendererConfig(sub_frames=sub_frames, human_light=False)
        return Renderer(scene, {}, RobotConfig(camera=camera), config)


def turning(_, step: float, *, rate_radps: float = TURN_RADPS) -> np.ndarray:
    return CAMERA.T_world_camera(0.0, 0.0, rate_radps * 0.05 * step, 0.0)


def bar(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
    return np.clip((0.08 - np.abs(azimuth)) / 0.05, 0.0, 1.0)


def take(camera: CameraConfig, bright, pose_at=turning, sub_frames: int = 8) -> Images:
    return taken(capture(camera, bright, sub_frames), pose_at, 0)


def light(image: np.ndarray) -> np.ndarray:
    return light_of_byte()[image[..., 0]] / 65535


def test_motion_blur_is_as_long_as_the_turn_and_keeps_the_light() -> None:
    exposure_s = 0.04
    sharp = light(take(CAMERA, bar).rgb)
    blurred = light(take(replace(CAMERA, exposure_s=exposure_s), bar, sub_frames=32).rgb)
    row = CAMERA.height_px // 2
    assert blurred[row].mean() == pytest.approx(sharp[row].mean(), rel=0.01)
    dark = sharp[row].min()
    width = [int((lights[row] > dark + 0.01).sum()) for lights in (sharp, blurred)]
    streak_px = CAMERA.K_px[0, 0] * TURN_RADPS * exposure_s
    assert width[1] - width[0] == pytest.approx(streak_px, abs=2)
    # All of it is in the past: the robot turns left, so the bar was further left in the image's past.
    centre_px = np.average(np.arange(CAMERA.width_px) + 0.5, weights=blurred[row] - dark)
    assert centre_px == pytest.approx(CAMERA.width_px / 2 - streak_px / 2, abs=0.5)


def test_rolling_shutter_shows_upper_rows_earlier() -> None:
    readout_s = 0.04
    image = light(take(replace(CAMERA, readout_s=readout_s), bar, sub_frames=32).rgb)
    columns = np.arange(CAMERA.width_px) + 0.5
    centres = np.array([np.average(columns, weights=row - image.min()) for row in image])
    skew_px = CAMERA.K_px[0, 0] * TURN_RADPS * readout_s
    # Turning left moves the world to the right in the image, from row to row.
    assert centres[-1] - centres[0] == pytest.approx(skew_px, abs=1.0)
    assert (np.diff(centres) >= -0.01).all()
    assert centres[-1] == pytest.approx(CAMERA.width_px / 2, abs=1.0)
    mirrored = light(take(replace(CAMERA, readout_s=readout_s), bar, partial(turning, rate_radps=-TURN_RADPS)).rgb)
    assert np.average(columns, weights=mirrored[0] - mirrored.min()) > CAMERA.width_px / 2 + 2.5


def test_mask_shows_each_row_at_the_middle_of_its_exposure() -> None:
    images = take(replace(CAMERA, exposure_s=0.02, readout_s=0.03), bar, sub_frames=64)
    columns = np.arange(CAMERA.width_px) + 0.5
    assert images.mask is not None
    for row, time_s in ((0, -0.04), (CAMERA.height_px - 1, -0.01)):
        expected = CAMERA.width_px / 2 + CAMERA.K_px[0, 0] * math.tan(TURN_RADPS * time_s)
        assert columns[images.mask[row] > 0].mean() == pytest.approx(expected, abs=0.6)


def test_what_stands_still_is_drawn_once() -> None:
    taking = capture(replace(CAMERA, exposure_s=0.02, readout_s=0.02), bar)
    still = taken(taking, lambda *_: turning(None, 0.0), 5)
    assert taking.rasterizers[""].batches == [1]
    assert np.array_equal(still.rgb, take(CAMERA, bar).rgb)


@pytest.mark.parametrize(
    ("camera", "batches"),
    [
        (CAMERA, [3]),
        (replace(CAMERA, exposure_s=0.04), [5, 3, 4]),
        (replace(CAMERA, distortion="fisheye", exposure_s=0.04), [5, 3, 4]),
    ],
)
def test_views_of_several_frames_are_drawn_together(camera: CameraConfig, batches: list[int]) -> None:
    one_by_one, together = capture(camera, bar, 4), capture(camera, bar, 4, views_at_once=5)
    shots = [Shot(pose_at=turning, step=step) for step in range(3)]
    for one, other in zip(one_by_one.render(shots), together.render(shots), strict=True):
        assert np.array_equal(one[""].rgb, other[""].rgb)
    assert together.rasterizers[""].batches == batches
    assert set(one_by_one.rasterizers[""].batches) == {1}


def test_frames_are_drawn_when_they_are_taken() -> None:
    taking = capture(replace(CAMERA, exposure_s=0.04), bar, 4)
    next(taking.render([Shot(pose_at=turning, step=step) for step in range(9)]))
    assert taking.rasterizers[""].batches == [1] * 4


def straightness_px(image: np.ndarray) -> float:
    """Largest distance of a bright curve's points from the straight line through its ends."""
    weights = light(image) - light(image).min()
    rows = np.arange(len(weights)) + 0.5
    centres = (weights * (np.arange(weights.shape[1]) + 0.5)).sum(axis=1) / weights.sum(axis=1)
    line = np.interp(rows, rows[[0, -1]], centres[[0, -1]])
    return float(np.abs(centres - line).max())


def test_straight_line_bends_as_the_lens_says() -> None:
    def post(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
        return np.clip((0.05 - np.abs(azimuth - 0.6)) / 0.03, 0.0, 1.0)

    still = partial(turning, rate_radps=0.0)
    assert straightness_px(take(CAMERA, post, still).rgb) < 0.6
    taking = capture(replace(CAMERA, distortion="brown_conrady", k1=-0.1), post)
    lens = make_lens(taking.robot.camera)
    image = taken(taking, still, 0).rgb
    # The post is where x / z = -tan(0.6); its point at each row is found by the lens itself.
    elevations = np.linspace(-1.5, 1.5, 400)
    curve = lens.pixels(np.stack([np.full_like(elevations, -math.tan(0.6)), elevations], axis=1))
    weights = light(image) - light(image).min()
    centres = (weights * (np.arange(CAMERA.width_px) + 0.5)).sum(axis=1) / weights.sum(axis=1)
    expected = np.interp(np.arange(CAMERA.height_px) + 0.5, curve[:, 1], curve[:, 0])
    assert np.abs(centres - expected)[2:-2].max() < 0.3
    assert straightness_px(image) > 1.5


def test_wide_fisheye_shows_a_level_horizon_and_depth_along_the_optical_axis() -> None:
    camera = CameraConfig(height_px=72, width_px=128, horizontal_fov_deg=150.0, distortion="fisheye")
    still = partial(turning, rate_radps=0.0)
    images = take(camera, lambda azimuth, elevation: (elevation > 0.0).astype(float), still)
    assert (images.rgb[:35] > 250).all()
    assert (images.rgb[37:] < 70).all()
    taking = capture(camera, bar)
    remap = taking.episode_camera("", "").remap
    assert remap is not None
    assert remap.faces == (0, 1, 2)
    assert images.depth_m is not None
    assert images.normal is not None
    # Faces see walls 2 m along their own axes.
    assert images.depth_m[36, 64] == pytest.approx(2.0)
    angle = math.radians(75.0) * 63.5 / 64
    assert images.depth_m[36, 0] == pytest.approx(2.0 / math.tan(angle), rel=0.01)
    assert images.normal[36, 0] == pytest.approx((math.sin(angle), 0.0, -math.cos(angle)), abs=0.03)
    assert (images.alpha == 1.0).all()


def with_optics(renderer: Renderer, config: RendererConfig, **optics) -> Renderer:
    robot = replace(renderer.robot, camera=replace(renderer.robot.camera, **optics))
    return Renderer(renderer.scene, wearers(), robot, config)


@pytest.fixture(scope="module")
def phone(renderer: Renderer) -> Renderer:
    plain = RendererConfig(image_format="png", contact_shadow=True)
    camera, config = sensor_phone_like(renderer.robot.camera, plain)
    return Renderer(renderer.scene, wearers(), replace(renderer.robot, camera=camera), config)


def test_frames_are_the_same_in_any_order_and_from_any_renderer(phone: Renderer, episode) -> None:
    scenario, motions, trajectory = episode
    first = [sample.image for sample in episode_samples(phone, scenario, motions, trajectory)]
    other = Renderer(phone.scene, wearers(), phone.robot, phone.config)
    elsewhere = replace(scenario, episode=EpisodeKey(seed=1, split=Split.TEST, index=3))
    next(episode_samples(other, elsewhere, motions, trajectory))
    assert first == [sample.image for sample in episode_samples(other, scenario, motions, trajectory)]
    assert next(episode_samples(phone, elsewhere, motions, trajectory)).image != first[0]


def test_header_holds_the_lens_that_was_drawn(phone: Renderer, episode) -> None:
    scenario, _, trajectory = episode
    camera = phone.episode_camera("", scenario.episode)
    header = episode_header(phone, scenario, trajectory)
    assert np.array_equal(np.reshape(header.K_px, (3, 3)), camera.config.K_px)
    assert (header.height_px, header.width_px) == (48, 80)
    assert header.distortion_model == "plumb_bob"
    assert len(header.distortion) == 5
    assert header.distortion[0] == camera.config.k1 != 0.0


def test_view_with_episode_and_path_is_the_image_that_is_recorded(phone: Renderer, episode) -> None:
    scenario, motions, trajectory = episode
    recorded = [_decoded(sample.image) for sample in episode_samples(phone, scenario, motions, trajectory)]
    camera, floor = phone.robot.camera, phone.scene.maps.floor
    people = Humans(key="walk", humans=motions.humans)
    for step in (0, 1, 2, 6):
        path = trajectory.xyyaw[max(step - 2, 0) : step + 1].tolist()
        x_m, y_m, yaw_rad = path[-1]
        pose = camera.T_world_camera(x_m, y_m, yaw_rad, floor.at(x_m, y_m))
        whole = RenderView(
            people="walk", step=step, T_world_camera=pose, episode=scenario.episode, path_xyyaw=tuple(map(tuple, path))
        )
        views = (whole, replace(whole, path_xyyaw=()), replace(whole, episode=None))
        images = handle_render(phone, RenderRequest(views=views, people=(people,))).rgb
        assert np.array_equal(images[0], recorded[step])
        assert not np.array_equal(images[2], recorded[step])
        if step > 0:
            assert not np.array_equal(images[1], recorded[step])


def _decoded(image: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(image, dtype=np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def test_camera_that_is_mounted_elsewhere_sees_from_there(renderer: Renderer, episode) -> None:
    scenario, _, trajectory = episode
    png = RendererConfig(image_format="png")
    ahead = with_optics(renderer, png, mount_x_m=0.2, mount_y_m=-0.1, mount_height_m=0.7, mount_pitch_deg=20.0)
    (sample, *_) = episode_samples(ahead, scenario, EpisodeMotions(humans=()), trajectory)
    # The same pose, of a camera on the robot's centre: a robot that stands where the camera is.
    T = renderer.robot.camera.T_world_camera(0.2, -0.1, 0.0, renderer.scene.maps.floor.at(0.0, 0.0) + 0.2)
    pitch = np.radians(20.0)
    T[:3, 1:3] = T[:3, 1:3] @ [[np.cos(pitch), np.sin(pitch)], [-np.sin(pitch), np.cos(pitch)]]
    assert np.array_equal(_decoded(sample.image), drawn(renderer, T, (), 0).rgb)


def test_views_have_noise_of_their_humans_and_step_and_no_blur(phone: Renderer, human: HumanMotion) -> None:
    pose = phone.robot.camera.T_world_camera(0.0, 0.0, 0.0, 0.0)
    views = tuple(RenderView(people="", step=step, T_world_camera=pose) for step in (4, 4, 5))
    images = handle_render(phone, RenderRequest(views=views)).rgb
    assert np.array_equal(images[0], images[1])
    difference = images[0].astype(int) - images[2]
    assert 0 < np.abs(difference).mean() < 12
    assert abs(difference.mean()) < 0.5


def test_blur_comes_from_humans_too(renderer: Renderer, episode) -> None:
    _, motions, _ = episode
    slow = with_optics(renderer, RendererConfig(image_format="png"), exposure_s=0.05)
    pose = slow.robot.camera.T_world_camera(0.0, 0.0, 0.0, slow.scene.maps.floor.at(0.0, 0.0))
    blurred = taken(slow, lambda *_: pose, 2, humans=motions.humans).rgb.astype(int)
    sharp = drawn(renderer, pose, motions.humans, 2).rgb.astype(int)
    changed = np.abs(blurred - sharp).max(axis=2) > 8
    assert 0.01 < changed.mean() < 0.5
    empty = drawn(renderer, pose, (), 2).rgb.astype(int)
    person = np.abs(sharp - empty).max(axis=2) > 0
    assert changed[:, :10].sum() == 0
    assert changed[person].sum() > 0


def test_lens_that_the_camera_cannot_have_is_refused_at_once(renderer: Renderer) -> None:
    robot = RobotConfig(camera=CameraConfig(distortion="brown_conrady"))
    with pytest.raises(ConfigError, match="folds the image"):
        Renderer(renderer.scene, wearers(), robot, RendererConfig(sensor=SensorConfig(k1=(-0.4, 0.0))))


def test_blurred_image_is_the_mean_light_along_the_robots_arc(renderer: Renderer, episode) -> None:
    scenario, _, trajectory = episode
    rows = [(0.0, 0.0, 0.0)]
    for _ in range(6):
        rows.append(step_unicycle(*rows[-1], 0.5, 1.0, 0.05))
    arcs = replace(trajectory, xyyaw=np.array(rows))
    blurring = with_optics(renderer, RendererConfig(image_format="png", sub_frames=4), exposure_s=0.04)
    sample = list(episode_samples(blurring, scenario, EpisodeMotions(humans=()), arcs))[4]
    blurred = cv2.imdecode(np.frombuffer(sample.image, dtype=np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    poses = [step_unicycle(*rows[3], 0.5, 1.0, 0.05 - before_s) for before_s in (0.035, 0.025, 0.015, 0.005)]
    camera, floor = renderer.robot.camera, renderer.scene.maps.floor
    sharp = [
        drawn(renderer, camera.T_world_camera(x_m, y_m, yaw_rad, floor.at(x_m, y_m)), (), 0).rgb
        for x_m, y_m, yaw_rad in poses
    ]
    expected = byte_of_light()[np.rint(np.mean([light_of_byte()[image] for image in sharp], axis=0)).astype(int)]
    assert np.abs(blurred.astype(int) - expected).max() <= 1
    assert np.abs(blurred.astype(int) - sharp[-1]).max() > 20


@pytest.mark.parametrize("lens", ["brown_conrady", "fisheye"])
def test_depth_and_mask_come_through_the_lens(renderer: Renderer, human: HumanMotion, lens: str) -> None:
    outputs = ("rgb", "median_depth", "alpha", "mask")
    pose = renderer.robot.camera.T_world_camera(0, 0, 0, 0.0)
    bent = with_optics(renderer, RendererConfig(), distortion=lens, exposure_s=0.01)
    through, plain = (drawn(one, pose, (human,), 1, outputs) for one in (bent, renderer))
    for images in (through, plain):
        assert images.normal is images.depth_m is None
        assert images.mask is not None
        assert set(np.unique(images.mask)) == {0, 1}
    u, v = np.meshgrid(np.arange(plain.rgb.shape[1]) + 0.5, np.arange(plain.rgb.shape[0]) + 0.5)
    rays = make_lens(bent.robot.camera).rays(np.stack([u, v], axis=-1).reshape(-1, 2))
    K = renderer.robot.camera.K_px
    columns = np.floor(rays[:, 0] * K[0, 0] + K[0, 2]).astype(int)
    rows = np.floor(rays[:, 1] * K[1, 1] + K[1, 2]).astype(int)
    inside = (columns >= 0) & (columns < u.shape[1]) & (rows >= 0) & (rows < u.shape[0])
    assert inside.mean() > 0.6
    for name in ("mask", "median_depth_m"):
        one = getattr(through, name).reshape(-1)[inside]
        two = getattr(plain, name)[rows[inside], columns[inside]]
        same = np.isclose(one, two, rtol=0.03) | (np.isinf(one) & np.isinf(two))
        assert same.mean() > 0.9


def test_shadows_leave_depth_and_mask_alone(renderer: Renderer, human: HumanMotion) -> None:
    plain = Renderer(renderer.scene, wearers(), renderer.robot, RendererConfig(contact_shadow=False))
    shadowed = Renderer(renderer.scene, wearers(), renderer.robot, RendererConfig(contact_shadow=True))
    pose = renderer.robot.camera.T_world_camera(0, 0, 0, 0.0)
    one, two = (drawn(d, pose, (human,), 0, ("rgb", "depth", "mask")) for d in (shadowed, plain))
    assert np.array_equal(one.depth_m, two.depth_m)
    assert np.array_equal(one.mask, two.mask)
    assert np.array_equal(one.rgb, drawn(shadowed, pose, (human,), 0).rgb)


def test_both_backends_give_every_output_and_samples_carry_what_is_asked_for(
    renderer: Renderer, episode, human: HumanMotion
) -> None:
    scenario, motions, trajectory = episode
    config = RendererConfig(outputs=OUTPUTS)
    asked = with_optics(renderer, config, distortion="fisheye")
    sample = next(episode_samples(asked, scenario, motions, trajectory))
    assert set(sample.outputs) == set(OUTPUTS) - {"rgb"}
    assert sample.intact
    reference = with_optics(renderer, replace(config, backend="reference"), distortion="fisheye")
    pose = renderer.robot.camera.T_world_camera(0, 0, 0, 0.0)
    slow, fast = (drawn(one, pose, (human,), 0, OUTPUTS) for one in (reference, asked))
    for entry in fields(Images):
        one, two = getattr(slow, entry.name), getattr(fast, entry.name)
        assert np.isclose(one, two, rtol=0.01, atol=0.03 if entry.name != "rgb" else 2).mean() > 0.97, entry.name


@pytest.mark.parametrize(("name", "optics"), [("brown_conrady", {"k1": -0.06, "p1": 0.002}), ("fisheye", {"k2": 0.01})])
def test_crooked_camera_takes_what_it_took(name, optics, golden_figures, monkeypatch: pytest.MonkeyPatch) -> None:
    """A lens, motion blur, a rolling shutter, vignetting and noise, before patches at infinity."""
    camera = CameraConfig(
        height_px=41, width_px=67, horizontal_fov_deg=87.0, distortion=name, **optics, exposure_s=0.017,
        readout_s=0.023, vignetting=0.3, red_gain=1.2, blue_gain=0.8, exposure_ev=-0.3, shot_noise=0.02,
        read_noise=0.01,
    )  # fmt: skip

    def patches(azimuth: np.ndarray, elevation: np.ndarray) -> np.ndarray:
        return 0.5 + 0.5 * np.sign(np.sin(9.0 * azimuth + 1.0) * np.sin(7.0 * elevation - 0.4))

    monkeypatch.setattr(renderer_module, "sensor_key", lambda *_: (3, 4))
    images = take(camera, patches, sub_frames=5)
    golden_figures(f"sensor/taken {name}", images.rgb.reshape(-1, 3) / 64.0)
    rest = images.depth_m, images.mask, images.alpha, images.normal
    golden_figures(f"sensor/taken besides {name}", *(array.reshape(41 * 67, -1) for array in rest))
