"""Episodes that are encoded for their place in a shard."""

import dataclasses
from typing import Any

import numpy as np
import pytest

from readygo.common.dataset import EpisodeChunk, ShardPlace, encode_episode, read_chunk
from readygo.common.dataset.encode import outputs_of
from readygo.common.dataset.stage import Scenery
from readygo.common.errors import DatasetError
from readygo.common.messages import DriverKind
from tests.common.dataset.episodes import ROBOT, make_episode, with_goal_image, with_left_camera
from tests.common.dataset.maps import make_maps

STAGE = Scenery(robot=ROBOT, maps=make_maps())


def episode(**asked: Any) -> tuple[Any, list[Any]]:
    """Two humans, some numbers zero, and what `asked` says."""
    header, samples = make_episode(3, 12, **asked)
    flat = dataclasses.replace(samples[0], robot_xyzyaw=(0.0, -0.0, 0.0, 0.0), action_v_mps=0.0)
    return header, [flat, *samples[1:]]


def with_expert(header: Any, samples: list[Any]) -> tuple[Any, list[Any]]:
    ahead = ((0.5, 0.1), (0.25, 0.0))
    every = dataclasses.replace(header, image_every=2, driver=DriverKind.POLICY)
    blind = {"image": b"", "outputs": {}, "expert_commands": ()}
    return every, [
        dataclasses.replace(sample, **(blind if sample.seq % 2 else {"expert_commands": ahead})) for sample in samples
    ]


def without_people(header: Any, samples: list[Any]) -> tuple[Any, list[Any]]:
    return header, [dataclasses.replace(sample, humans_xyzyaw=(), labels=()) for sample in samples]


def fields(chunk: EpisodeChunk) -> dict[str, Any]:
    """All of a chunk, arrays as bytes."""
    found = {field.name: getattr(chunk, field.name) for field in dataclasses.fields(chunk)}
    for name in ("outputs", "message_offsets"):
        found[name] = {key: rows.tobytes() for key, rows in found[name].items()}
    return {**found, "data": bytes(chunk.data), "samples": chunk.samples.tobytes()}


EPISODES = {
    "plain": episode(),
    "outputs": episode(outputs=("depth", "mask")),
    "labels": episode(labels=True),
    "expert": with_expert(*episode(outputs=("depth",))),
    "drawn": episode(drawn={"radius_m": 0.4, "mount_height_m": 0.3}),
    "cameras": with_left_camera(*episode(outputs=("depth",), labels=True)),
    "nobody": without_people(*episode(labels=True)),
    "goal": with_goal_image(*with_left_camera(*episode())),
}


@pytest.mark.parametrize("kind", EPISODES)
@pytest.mark.parametrize("start_ns", [0, 7_000_000_000])
@pytest.mark.parametrize("with_map", [False, True])
def test_in_its_place_it_is_what_staging_makes_of_its_canonical_form(kind: str, start_ns: int, with_map: bool) -> None:
    header, samples = EPISODES[kind]
    plain = encode_episode(header, 2, samples)
    placed = encode_episode(header, 2, samples, ShardPlace(stage=STAGE, start_ns=start_ns, with_map=with_map))
    assert fields(placed) == fields(STAGE.stage_episode(plain, start_ns, with_map=with_map))
    assert placed.sha256 == plain.sha256


@pytest.mark.parametrize("kind", EPISODES)
def test_it_says_of_itself_what_a_reader_finds(kind: str) -> None:
    header, samples = EPISODES[kind]
    chunk = encode_episode(header, 2, samples)
    assert fields(chunk) == fields(read_chunk(chunk.data))
    assert tuple(chunk.outputs) == outputs_of(header, samples[0])


@pytest.mark.parametrize(
    "wrong",
    [{"time_ns": -(10**12)}, {"time_ns": 2**64}, {"robot_xyzyaw": (10**400, 0.0, 0.0, 0.0)}, {"expert_cost": 10**400}],
)
def test_numbers_that_no_shard_can_hold_are_refused(wrong: dict[str, Any]) -> None:
    header, samples = episode()
    odd = dataclasses.replace(samples[4], **wrong)
    with pytest.raises(DatasetError, match="Episode train-7-000003 cannot be recorded"):
        encode_episode(header, 1, [*samples[:4], odd, *samples[5:]])


def test_a_calibration_of_another_layout_is_refused() -> None:
    header, samples = episode()
    with pytest.raises(DatasetError, match="calibration of another layout"):
        encode_episode(dataclasses.replace(header, K_px=tuple(np.zeros(4).tolist())), 1, samples)


def test_images_of_a_camera_that_the_header_does_not_name_are_refused() -> None:
    header, samples = EPISODES["cameras"]
    with pytest.raises(DatasetError, match="further cameras \\['left'\\], its header names \\[\\]"):
        encode_episode(dataclasses.replace(header, cameras=()), 2, samples)


def test_image_of_the_goal_stands_at_the_first_sample_alone() -> None:
    header, samples = EPISODES["goal"]
    places = encode_episode(header, 2, samples).outputs["goal_image"]
    assert places["length"][0] > 0
    assert not places["length"][1:].any()
