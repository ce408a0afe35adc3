import dataclasses
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from readygo.common.errors import PolicyError
from readygo.common.perception import PerceptionSpec
from readygo.common.perception.people import PRESENCE
from readygo.common.policy import PolicySpec, load_policy
from readygo.common.policy.motion import own_motion
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.services.trainer import RECIPES, TrainConfig, train_policy, with_overrides
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.finetune import load_network
from readygo.services.trainer.learner import Learner
from readygo.services.trainer.model import PolicyNet
from readygo.services.trainer.parts import build_parts, timing_of
from readygo.services.trainer.perception.export import export_perception
from readygo.services.trainer.perception.network import PerceptionNet
from readygo.services.trainer.perception.train import perceive, shown_of
from readygo.services.trainer.pretrained import PretrainedEncoder
from readygo.services.trainer.ranks import Ranks
from readygo.services.trainer.run import encoder_of
from tests.services.trainer.conftest import make_source
from tests.services.trainer.perception.conftest import CAMERA, ROBOT, make_looks

WIDTHS = (4, 4, 8, 8, 16)
CONFIG = with_overrides(
    RECIPES["pretrained"](),
    samples=128,
    threads=1,
    precision="fp32",
    widths=WIDTHS,
    latent_count=12,
    batch_size=32,
    chain_length=4,
)


def trained_looking(net: nn.Module) -> None:
    """Give its normalisations statistics that are not those of the beginning."""
    for module in net.modules():
        if isinstance(module, nn.BatchNorm2d):
            assert module.running_mean is not None
            assert module.running_var is not None
            module.running_mean.normal_(0, 0.3)
            module.running_var.uniform_(0.3, 2.0)


def write_perception(folder: Path, *, robot: RobotConfig = ROBOT, spacing_s: float = 0.2) -> PerceptionNet:
    torch.manual_seed(5)
    net = PerceptionNet(robot.camera, WIDTHS).eval()
    trained_looking(net)
    export_perception(net, PerceptionSpec(robot=robot, spacing_s=spacing_s), folder)
    return net


def with_perception(folder: Path, config: TrainConfig = CONFIG) -> TrainConfig:
    return dataclasses.replace(config, perception=str(folder))


def test_encoder_reads_what_perception_tells_of_the_same_frames(tmp_path: Path) -> None:
    net, looks = write_perception(tmp_path), make_looks()
    encoder = PretrainedEncoder(CAMERA, WIDTHS, 12).eval()
    encoder.perception.load_state_dict(net.state_dict())
    rows, motion = np.arange(6), np.random.default_rng(0).uniform(-0.2, 0.2, (6, 8)).astype(np.float32)
    looks.motion[rows] = motion
    frames = torch.from_numpy(looks.frames[looks.window[rows]]).permute(0, 1, 4, 2, 3).float() / 127.5 - 1.0
    told: list[Tensor] = []
    encoder.latent.register_forward_pre_hook(lambda _, inputs: told.append(inputs[0]))
    encoder(frames.flatten(1, 2), torch.from_numpy(motion))
    columns = told[0].unflatten(1, (-1, 32))
    features = net.features(shown_of(net, looks, rows), torch.from_numpy(motion))
    read = torch.relu(encoder.features(features))
    assert torch.allclose(columns[:, :16], read, atol=0.02)
    maps, free_m = perceive(net, looks, rows, PerceptionSpec(robot=ROBOT))
    there = np.stack([each[PRESENCE].max(axis=0) for each in maps])
    assert np.abs(columns[:, 16].detach().numpy() - there).max() < 0.01
    assert np.abs(columns[:, 20].detach().exp().numpy() / free_m - 1).max() < 0.02


@pytest.mark.parametrize("precision", ["fp32", "bf16"])
def test_training_changes_what_reads_and_not_what_perceives(tmp_path: Path, precision: str) -> None:
    net = write_perception(tmp_path / "perception")
    source = dataclasses.replace(make_source(camera=CAMERA), has_expert=True, has_risks=True)
    config = with_overrides(with_perception(tmp_path / "perception"), precision=precision)
    train_policy(source, config, tmp_path / "policy")  # type: ignore[arg-type]
    training = load_policy(tmp_path / "policy").spec.training
    assert training["config"]["perception"] == ""
    assert len(training["data"]["perception_weights"]) == 64
    policy = load_network(tmp_path / "policy")
    assert isinstance(policy.encoder, PretrainedEncoder)
    for name, value in net.state_dict().items():
        assert torch.equal(policy.encoder.perception.state_dict()[name], value), name
    torch.manual_seed(CONFIG.seed)
    fresh = PolicyNet(ROBOT, CONFIG.network)
    assert not torch.equal(policy.encoder.get_parameter("latent.weight"), fresh.encoder.get_parameter("latent.weight"))


@pytest.mark.parametrize(("height_px", "width_px"), [(72, 128), (24, 100), (72, 161)])
def test_exported_graph_answers_what_torch_answers(tmp_path: Path, height_px: int, width_px: int) -> None:
    torch.manual_seed(3)
    robot = RobotConfig(camera=CameraConfig(height_px=height_px, width_px=width_px))
    model = PolicyNet(robot, CONFIG.network).eval()
    trained_looking(model)
    export_policy(model, PolicySpec(robot=robot, frame_spacing_s=0.2), tmp_path)
    policy = load_policy(tmp_path, robot=robot)
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (9, height_px, width_px, 3), dtype=np.uint8)
    memory, goal, still = policy.start(), np.array([[3.0, 1.0]], np.float32), np.zeros((1, 2), np.float32)
    for step in range(9):
        action = policy.step([memory], images[step : step + 1], still, goal)
    frames = torch.from_numpy(images / np.float32(127.5) - 1).permute(0, 3, 1, 2)
    pose = np.zeros((1, 3))
    motion = torch.from_numpy(own_motion(pose[:, None].repeat(2, axis=1), pose, still)).repeat(3, 1)
    # It decides every 0.2 s, four steps, and remembers its earlier decisions.
    windows = torch.tensor([[0, 0, 0], [0, 0, 4], [0, 4, 8]])
    with torch.inference_mode():
        latents, told = model.encoder(frames[windows].flatten(1, 2), motion), model.normalise_motion(motion)
        remembered = model.remember(latents, told, torch.tensor([[0, 1, 2]]))
        answers = model.act(latents[2:], told[2:], torch.from_numpy(goal), None, remembered[2:])
        assert np.abs(model.clip(model.decide(answers)).numpy() - action).max() < 1e-4


def test_perception_that_does_not_fit_is_refused(tmp_path: Path) -> None:
    here = tmp_path / "here"
    write_perception(here)
    assert encoder_of(ROBOT, with_perception(here)) is not None
    assert encoder_of(ROBOT, TrainConfig()) is None
    with pytest.raises(PolicyError, match="give its folder with --perception"):
        encoder_of(ROBOT, CONFIG)
    with pytest.raises(PolicyError, match="goes with --recipe pretrained"):
        encoder_of(ROBOT, with_perception(here, TrainConfig()))
    with pytest.raises(PolicyError, match=r"perception\.toml"):
        encoder_of(ROBOT, with_perception(tmp_path))
    with pytest.raises(PolicyError, match="another camera"):
        encoder_of(RobotConfig(camera=CameraConfig(height_px=72, width_px=96)), with_perception(here))
    with pytest.raises(PolicyError, match=r"0\.2 s apart, the policy 0\.5 s"):
        encoder_of(ROBOT, with_overrides(with_perception(here), frame_spacing_s=0.5))
    with pytest.raises(PolicyError, match="other widths"):
        encoder_of(ROBOT, with_overrides(with_perception(here), widths=(4, 4, 8, 8, 24)))
    (here / "weights.safetensors").write_bytes(b"none")
    with pytest.raises(PolicyError, match=r"weights\.safetensors cannot be read"):
        encoder_of(ROBOT, with_perception(here))


def test_motion_ends_at_the_newest_image_in_training_and_driving(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    late = dataclasses.replace(ROBOT, camera=dataclasses.replace(CAMERA, latency_s=0.1))
    assert timing_of(late, CONFIG).to_image
    assert not timing_of(late, TrainConfig()).to_image
    export_policy(PolicyNet(late, CONFIG.network).eval(), PolicySpec(robot=late, frame_spacing_s=0.2), tmp_path)
    policy = load_policy(tmp_path, robot=late)
    assert policy.spec.graph.inputs["motion"] == "image_motion"
    fed, session = [], policy._session  # type: ignore[attr-defined]

    def run(outputs: object, inputs: dict[str, np.ndarray]) -> object:
        fed.append(inputs["motion"][0])
        return session.run(outputs, inputs)

    monkeypatch.setattr(policy, "_session", SimpleNamespace(run=run))
    memory, turning = policy.start(), np.array([[0.0, 1.0]], np.float32)
    images = np.zeros((1, CAMERA.height_px, CAMERA.width_px, 3), np.uint8)
    for _ in range(15):
        policy.step([memory], images, turning, np.array([[3.0, 1.0]], np.float32))
    # Frames are 0.2 s apart, and the newest one was taken 0.1 s ago.
    assert fed[-1] == pytest.approx([0.0, 0.0, -0.4, 0.0, 0.0, -0.2, 0.0, 1.0], abs=1e-5)


def test_run_goes_on_with_the_same_weights_alone(tmp_path: Path) -> None:
    here, moved = tmp_path / "here", tmp_path / "moved"
    write_perception(here)
    source = dataclasses.replace(make_source(camera=CAMERA), has_expert=True, has_risks=True)
    train_policy(source, with_perception(here), tmp_path / "policy")  # type: ignore[arg-type]
    here.rename(moved)
    longer = dataclasses.replace(with_perception(moved), samples=192)
    assert train_policy(source, longer, tmp_path / "policy")["steps"] == 6  # type: ignore[arg-type]
    torch.manual_seed(6)
    export_perception(PerceptionNet(CAMERA, WIDTHS).eval(), PerceptionSpec(robot=ROBOT), moved)
    with pytest.raises(PolicyError, match="another perception_weights"):
        train_policy(source, longer, tmp_path / "policy")  # type: ignore[arg-type]


def test_training_is_shown_what_the_encoder_has_of_each_sample(tmp_path: Path) -> None:
    net = write_perception(tmp_path / "perception")
    config = with_perception(tmp_path / "perception")
    source = dataclasses.replace(make_source(camera=CAMERA, episodes=2), has_expert=True, has_risks=True)
    training, _ = build_parts(source, None, config)  # type: ignore[arg-type]
    learner = Learner(ROBOT, config, Ranks(), net.state_dict())
    assert isinstance(learner.model.encoder, PretrainedEncoder)
    table, samples = training.table, np.array([0, 9, 30, 31])
    shown = learner.objective.training(table, training.frames, samples, np.random.default_rng(0))
    assert torch.equal(shown.images, learner.objective.plain(table, training.frames, samples).images)
    images = [torch.from_numpy(source.picture(int(k))).permute(2, 0, 1) for k in range(60)]
    first = int(table.first[0])
    stacked = torch.stack(
        [torch.cat([images[first + max(k - back, 0)] for back in (8, 4, 0)]).float() / 127.5 - 1.0 for k in samples]
    )
    looked = learner.model.encoder.look(stacked, torch.from_numpy(table.motion[samples]))
    assert torch.allclose(shown.images, looked, atol=0.02, rtol=0.01)


def test_changed_images_cannot_be_looked_at_once() -> None:
    for name, value in (("shift_px", 2), ("yaw_error_rad", 0.1)):
        with pytest.raises(ValueError, match="shift_px and yaw_error_rad must be 0"):
            with_overrides(CONFIG, **{name: value})
