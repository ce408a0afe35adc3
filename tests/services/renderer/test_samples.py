import zlib
from dataclasses import replace

import cv2
import numpy as np
import pytest

from readygo.common.avatars import Avatar, joint_positions, pose_avatar
from readygo.common.errors import AvatarError, RunError
from readygo.common.images.files import decode_output
from readygo.common.images.images import OUTPUTS, Images
from readygo.common.messages import EpisodeMotions, HumanMotion, Humans, RenderView, sample_crc32
from readygo.common.rasterizer.interface import Rasterizer
from readygo.services.renderer import Renderer, RendererConfig, episode_header, episode_samples
from readygo.services.renderer.samples import Picture, described_samples, encode_image, encode_picture, facing_yaw
from tests.services.renderer.asking import render
from tests.services.renderer.pictures import drawn
from tests.services.renderer.wearers import wearers


def test_samples_describe_the_trajectory(renderer: Renderer, episode) -> None:
    scenario, motions, trajectory = episode
    samples = list(episode_samples(renderer, scenario, motions, trajectory))
    assert [sample.seq for sample in samples] == list(range(7))
    assert [sample.time_ns for sample in samples] == [k * 50_000_000 for k in range(7)]
    assert all(sample.intact and zlib.crc32(sample.image) == sample.crc32 for sample in samples)
    third = samples[2]
    assert (third.action_v_mps, third.action_w_radps, third.expert_cost) == (2.0, 4.0, 3.0)
    assert third.replanned
    assert not samples[3].replanned
    assert third.robot_xyzyaw == pytest.approx((0.1, 0.0, renderer.scene.maps.floor.at(0.1, 0.0), 0.2))
    c, s = np.cos(0.2), np.sin(0.2)
    assert third.goal_xy_robot_m == pytest.approx((c * 2.9 + s * 1.0, c * 1.0 - s * 2.9))
    assert samples[0].humans_xyzyaw[0][:2] == pytest.approx((2.0, -0.3))
    assert samples[0].humans_xyzyaw[0][2] == pytest.approx(renderer.scene.maps.floor.at(2.0, -0.3))
    assert abs(samples[0].humans_xyzyaw[0][3]) == pytest.approx(np.pi)
    assert samples[6].humans_xyzyaw[0] == pytest.approx((2.0, 0.0, samples[6].humans_xyzyaw[0][2], -np.pi / 2))
    assert (samples[3].human_visible, samples[4].human_visible) == (True, False)


def test_sample_image_is_what_the_camera_sees_there(renderer: Renderer, episode) -> None:
    scenario, motions, trajectory = episode
    camera = renderer.robot.camera
    png = Renderer(renderer.scene, wearers(), renderer.robot, RendererConfig(image_format="png"))
    sample = list(episode_samples(png, scenario, motions, trajectory))[5]
    image = cv2.imdecode(np.frombuffer(sample.image, dtype=np.uint8), cv2.IMREAD_COLOR)[..., ::-1]
    x, y, yaw = trajectory.xyyaw[5]
    pose = camera.T_world_camera(x, y, yaw, renderer.scene.maps.floor.at(x, y))
    seen = RenderView(people="p", step=5, T_world_camera=pose)
    assert np.array_equal(image, render(renderer, seen, people=(Humans(key="p", humans=motions.humans),)).rgb[0])


def test_jpeg_is_close_to_the_image(renderer: Renderer, episode) -> None:
    scenario, motions, trajectory = episode
    sample = next(episode_samples(renderer, scenario, motions, trajectory))
    assert sample.image[:2] == b"\xff\xd8"
    image = cv2.imdecode(np.frombuffer(sample.image, dtype=np.uint8), cv2.IMREAD_COLOR)[..., ::-1].astype(int)
    pose = renderer.robot.camera.T_world_camera(0, 0, 0, renderer.scene.maps.floor.at(0, 0))
    exact = drawn(renderer, pose, motions.humans, 0).rgb
    assert np.abs(image - exact).mean() < 6


def test_header_describes_the_episode(renderer: Renderer, episode, human: HumanMotion) -> None:
    scenario, _, trajectory = episode
    header = episode_header(renderer, scenario, trajectory)
    assert header.episode == scenario.episode
    assert header.sample_count == 7
    assert header.goal_xy_m == (3.0, 1.0)
    assert header.start_xyyaw == (0.0, 0.0, 0.0)
    assert (header.avatars, header.encounters) == ((human.avatar,), ("crossing",))
    assert (header.image_format, header.height_px, header.width_px) == ("jpeg", 48, 80)
    assert np.array_equal(np.reshape(header.K_px, (3, 3)), renderer.robot.camera.K_px)


def test_two_renderers_give_the_same_bytes(renderer: Renderer, episode) -> None:
    scenario, motions, trajectory = episode
    other = Renderer(renderer.scene, wearers(), renderer.robot, renderer.config)
    first = [sample.image for sample in episode_samples(renderer, scenario, motions, trajectory)]
    assert first == [sample.image for sample in episode_samples(other, scenario, motions, trajectory)]


def test_episode_with_an_unknown_avatar_is_refused(renderer: Renderer, episode) -> None:
    scenario, motions, trajectory = episode
    strangers = EpisodeMotions(humans=(replace(motions.humans[0], avatar="stranger"),))
    with pytest.raises(AvatarError):
        next(episode_samples(renderer, scenario, strangers, trajectory))


@pytest.mark.parametrize("orientation", [(0.0, 0.0, 0.0), (0.3, 1.2, -0.4), (0.0, -2.5, 0.1), (np.pi, 0.0, 0.01)])
def test_yaw_is_where_the_body_faces(renderer: Renderer, orientation: tuple[float, float, float]) -> None:
    avatar = next(iter(wearers().values()))
    pose = np.zeros((24, 3), dtype=np.float32)
    base = pose_avatar(avatar, np.zeros(3), pose).means_m.astype(np.float64)
    pose[0] = orientation
    turned = pose_avatar(avatar, np.zeros(3), pose).means_m.astype(np.float64)
    R = np.linalg.lstsq(base - base.mean(0), turned - turned.mean(0), rcond=None)[0].T
    # Upright and unturned, a body faces SMPL's +z: -y in the world.
    facing = R @ np.array([0.0, -1.0, 0.0])
    assert facing_yaw(pose[0]) == pytest.approx(np.arctan2(facing[1], facing[0]), abs=1e-4)


class AllImages:
    """A rasterizer that makes every kind of image, the depth of a view in metres being its number, from 1."""

    views_at_once = 1

    def __init__(self, rasterizer: Rasterizer) -> None:
        self.rasterizer, self.asked, self.count = rasterizer, set(), 0

    def render(self, views, outputs=("rgb",)) -> Images:
        self.asked.add(tuple(outputs))
        rgb = self.rasterizer.render(views).rgb
        step, self.count = self.count, self.count + 1
        depth_m = np.full(rgb.shape[:3], step + 1.0, dtype=np.float32)
        mask = np.full(rgb.shape[:3], step % 2, dtype=np.uint8)
        # The mean is twice as far as the median.
        return Images(
            rgb=rgb,
            depth_m=2 * depth_m if "depth" in outputs else None,
            median_depth_m=depth_m if "median_depth" in outputs else None,
            mask=mask if "mask" in outputs else None,
        )


def with_outputs(renderer: Renderer, *outputs: str, **settings: str) -> Renderer:
    changed = Renderer(renderer.scene, wearers(), renderer.robot, RendererConfig(outputs=outputs, **settings))
    changed.rasterizers[""] = AllImages(renderer.rasterizers[""])
    return changed


def test_samples_hold_the_outputs_that_the_config_asks_for(renderer: Renderer, episode) -> None:
    rich = with_outputs(renderer, "rgb", "depth", "mask")
    samples = list(episode_samples(rich, *episode))
    assert rich.rasterizers[""].asked == {("rgb", "median_depth", "mask")}
    for step, sample in enumerate(samples):
        assert sample.intact
        assert list(sample.outputs) == ["depth", "mask"]
        assert (decode_output("depth", sample.outputs["depth"]) == step + 1.0).all()
        assert (decode_output("mask", sample.outputs["mask"]) == step % 2).all()
    plain = list(episode_samples(renderer, *episode))
    assert [sample.image for sample in samples] == [sample.image for sample in plain]


def test_depth_is_the_mean_where_the_config_says_so_and_both_can_be_recorded(renderer: Renderer, episode) -> None:
    rich = with_outputs(renderer, "rgb", "depth", "median_depth", depth="mean")
    sample = next(episode_samples(rich, *episode))
    assert rich.rasterizers[""].asked == {("rgb", "depth", "median_depth")}
    assert list(sample.outputs) == ["depth", "median_depth"]
    assert (decode_output("depth", sample.outputs["depth"]) == 2.0).all()
    assert (decode_output("median_depth", sample.outputs["median_depth"]) == 1.0).all()


@pytest.mark.parametrize("backend", ["cpu", "reference"])
def test_every_output_can_be_recorded(renderer: Renderer, episode, backend: str) -> None:
    config = RendererConfig(backend=backend, outputs=OUTPUTS)
    rich = Renderer(renderer.scene, wearers(), renderer.robot, config)
    sample = next(episode_samples(rich, *episode))
    images = {name: decode_output(name, data) for name, data in sample.outputs.items()}
    assert tuple(images) == OUTPUTS[1:]
    person = images["mask"] == 1
    assert 0.01 < person.mean() < 0.5
    # The person walks 2 m ahead, the walls are 5 m away.
    assert np.abs(np.median(images["depth"][person]) - 2.0) < 0.5
    assert np.median(images["depth"][~person & np.isfinite(images["depth"])]) > 2.5
    assert np.abs(np.linalg.norm(images["normal"][person], axis=1) - 1.0).max() < 1e-3


def test_samples_hold_no_outputs_by_default(renderer: Renderer, episode) -> None:
    scenario, motions, trajectory = episode
    sample = next(episode_samples(renderer, scenario, motions, trajectory))
    assert sample.outputs == {}
    assert sample.crc32 == zlib.crc32(sample.image)


def test_samples_hold_the_labels_of_everybody(renderer: Renderer, episode, avatars: dict[str, Avatar]) -> None:
    _, motions, _ = episode
    (human,) = motions.humans
    assert episode_header(renderer, episode[0], episode[2]).labels
    joints = joint_positions(avatars[human.avatar], human.motion).astype(np.float32)
    for step, sample in enumerate(episode_samples(renderer, *episode)):
        (label,) = sample.labels
        np.testing.assert_array_equal(label.joints_m, joints[human.motion.row(step)])
        assert label.box[6] == sample.humans_xyzyaw[0][3]
        assert np.abs(label.footprint_xy_m - human.motion.root_m[human.motion.row(step), :2]).max() < 1.0


def test_labels_can_be_left_out(renderer: Renderer, episode) -> None:
    plain = Renderer(renderer.scene, wearers(), renderer.robot, RendererConfig(labels=False))
    assert not episode_header(plain, episode[0], episode[2]).labels
    samples = [next(episode_samples(r, *episode)) for r in (plain, renderer)]
    assert samples[0].labels == ()
    assert samples[0].image == samples[1].image
    assert replace(samples[1], labels=()) == samples[0]


def test_output_that_the_drawing_does_not_make_is_refused(renderer: Renderer, episode) -> None:
    with pytest.raises(RunError, match="cpu backend cannot do that: the view has no normal image"):
        next(episode_samples(with_outputs(renderer, "rgb", "normal"), *episode))


def test_every_number_of_a_crooked_episode_is_in_its_sample(renderer: Renderer, episode) -> None:
    scenario, motions, trajectory = episode
    rng, count = np.random.default_rng(4), len(trajectory.xyyaw)
    crooked = replace(
        trajectory, actions=rng.normal(size=(count, 2)), human_distance_m=rng.random(count),
        time_to_collision_s=rng.random(count), expert_cost=rng.random(count), replanned=rng.random(count) < 0.5,
        human_visible=rng.random(count) < 0.5, xyyaw=trajectory.xyyaw + np.array([0.3, -0.7, 2.5]),
    )  # fmt: skip
    pictures = [Picture(image=bytes([step]), outputs={"depth": bytes([step, 7])}) for step in range(count)]
    floor = renderer.scene.maps.floor
    for step, sample in enumerate(described_samples(renderer, scenario, motions, crooked, pictures)):
        x, y, yaw = crooked.xyyaw[step].tolist()
        assert (sample.seq, sample.image, sample.outputs) == (step, bytes([step]), {"depth": bytes([step, 7])})
        assert sample.time_ns == step * 50_000_000
        assert sample.crc32 == sample_crc32(sample.image, sample.outputs)
        assert (sample.action_v_mps, sample.action_w_radps) == tuple(crooked.actions[step].tolist())
        assert sample.robot_xyzyaw == pytest.approx((x, y, floor.at(x, y), yaw))
        dx, dy = scenario.goal_xy_m - (x, y)
        c, s = np.cos(yaw), np.sin(yaw)
        assert sample.goal_xy_robot_m == pytest.approx((c * dx + s * dy, c * dy - s * dx))
        assert sample.human_distance_m == crooked.human_distance_m[step]
        assert sample.time_to_collision_s == crooked.time_to_collision_s[step]
        assert sample.expert_cost == crooked.expert_cost[step]
        assert (sample.replanned, sample.human_visible) == (crooked.replanned[step], crooked.human_visible[step])
        motion = motions.humans[0].motion
        row = min(step, len(motion.root_m) - 1)
        human_x, human_y = motion.root_m[row, :2].tolist()
        (human,) = sample.humans_xyzyaw
        assert human[:3] == pytest.approx((human_x, human_y, floor.at(human_x, human_y)))
        assert human[3] == facing_yaw(motion.pose_axis_angle[row, 0])
        assert sample.labels[0].box[6] == pytest.approx(human[3])


RAMP = np.stack([*np.meshgrid(np.arange(0, 256, 8), np.arange(0, 256, 16)), np.full((16, 32), 40)], axis=-1)
RGB = RAMP.astype(np.uint8)


def decoded(data: bytes) -> np.ndarray:
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def test_png_is_the_image_with_red_first() -> None:
    data = encode_image(RGB, RendererConfig(image_format="png"))
    assert data.startswith(b"\x89PNG")
    assert np.array_equal(decoded(data), RGB)


def test_jpeg_is_near_the_image_and_nearer_and_larger_with_more_quality() -> None:
    low, high = (encode_image(RGB, RendererConfig(jpeg_quality=quality)) for quality in (20, 95))
    assert high.startswith(b"\xff\xd8")
    errors = [np.abs(decoded(data).astype(int) - RGB).mean() for data in (low, high)]
    assert errors[1] < errors[0]
    assert errors[1] < 6
    assert len(low) < len(high)


def test_outputs_are_those_of_the_config_besides_rgb() -> None:
    depth_m = np.full((1, 4, 5), 2.5, np.float32)
    images = Images(rgb=np.zeros((1, 4, 5, 3), np.uint8), depth_m=depth_m, mask=np.ones((1, 4, 5), np.uint8))[0]
    assert encode_picture({"": images}, RendererConfig()) == (encode_image(images.rgb, RendererConfig()), {})
    config = RendererConfig(outputs=("rgb", "depth"))
    files = encode_picture({"": images, "left": images}, config).outputs
    assert list(files) == ["depth", "left.rgb", "left.depth"]
    assert files["left.rgb"] == encode_image(images.rgb, config)
    assert np.array_equal(decode_output("depth", files["depth"]), depth_m[0])


def test_output_that_was_not_drawn_is_refused_with_the_backends_name() -> None:
    images = Images(rgb=np.zeros((1, 4, 5, 3), np.uint8))[0]
    with pytest.raises(RunError, match=r"^The reference backend cannot do that: .*normal"):
        encode_picture({"": images}, RendererConfig(backend="reference", outputs=("rgb", "normal")))
