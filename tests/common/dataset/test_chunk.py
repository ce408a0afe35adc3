import dataclasses
import hashlib

import numpy as np
import pytest

from readygo.common.dataset import encode_episode, read_chunk, schemas
from readygo.common.dataset.records import iter_messages
from readygo.common.errors import DatasetError
from readygo.common.messages import DriverKind, Outcome
from tests.common.dataset.episodes import golden_episode, make_episode, make_labels

GOLDEN_SHA256 = "a7395f7efdde6b4850eaa79b541a2797abbab063d2fbb797ae4f1843d68a59ba"
GOLDEN_LABELS_SHA256 = "62854865e6354dbd48c8c8998669752e2bf55ae08672b5a75155fb7a7d82ed70"
GOLDEN_OUTPUTS_SHA256 = "52b5bd8b1db18c267acf18e4f335605a5defb93a645e8434749d9e8a462a8cb9"


def test_samples_come_back_as_they_went_in() -> None:
    header, samples = make_episode(3)
    chunk = read_chunk(encode_episode(header, 2, samples).data)
    assert (chunk.episode, chunk.attempt) == (header.episode, 2)
    assert (chunk.height_px, chunk.width_px) == (24, 32)
    assert (chunk.start_xyyaw, chunk.goal_xy_m) == (header.start_xyyaw, header.goal_xy_m)
    for row, sample in zip(chunk.samples, samples, strict=True):
        offset = int(row["image_offset"])
        assert chunk.data[offset : offset + int(row["image_length"])] == sample.image
        assert row["time_ns"] == sample.time_ns
        assert row["action"].tolist() == pytest.approx((sample.action_v_mps, sample.action_w_radps), abs=1e-7)
        assert row["goal_xy_m"].tolist() == pytest.approx(sample.goal_xy_robot_m, rel=1e-6)
        assert row["pose"].tolist() == pytest.approx(sample.robot_xyzyaw, abs=1e-12)
        assert (row["human_visible"], row["replanned"]) == (sample.human_visible, sample.replanned)
        assert row["human_distance_m"] == np.float32(sample.human_distance_m)
        assert np.isinf(row["time_to_collision_s"])


@pytest.mark.parametrize("yaw_rad", [3.0, -3.0, 3.3, 6.0, -40.0])
def test_yaw_comes_back_wrapped(yaw_rad) -> None:
    header, samples = make_episode(0, 1)
    sample = dataclasses.replace(samples[0], robot_xyzyaw=(0.0, 0.0, 0.0, yaw_rad))
    pose = encode_episode(header, 1, [sample]).samples[0]["pose"]
    assert abs(pose[3]) <= np.pi
    assert np.exp(1j * pose[3]) == pytest.approx(np.exp(1j * yaw_rad))


def test_only_the_commit_knows_the_attempt() -> None:
    header, samples = make_episode(0)
    first, second = encode_episode(header, 1, samples), encode_episode(header, 2, samples)
    assert first.sha256 == second.sha256
    assert first.data != second.data
    commit_offset = first.message_offsets[schemas.EPISODE_COMMIT.number][0][1]
    assert first.data[:commit_offset] == second.data[:commit_offset]
    assert hashlib.sha256(first.data[:commit_offset]).hexdigest() == first.sha256


def test_hash_depends_on_every_sample() -> None:
    header, samples = make_episode(0)
    changed = [*samples[:5], dataclasses.replace(samples[5], expert_cost=1.6), *samples[6:]]
    assert encode_episode(header, 1, changed).sha256 != encode_episode(header, 1, samples).sha256


def test_bytes_of_an_episode_do_not_change_between_versions() -> None:
    header, samples = golden_episode()
    assert encode_episode(header, 1, samples).sha256 == GOLDEN_SHA256


def test_bytes_of_an_episode_with_outputs_do_not_change_between_versions() -> None:
    header, samples = golden_episode()
    header = dataclasses.replace(header, distortion_model="plumb_bob", distortion=(0.5, -0.25, 0.0, 0.125, 1.0))
    outputs = {name: f"{name} file".encode() for name in schemas.OUTPUT_CHANNELS}
    samples = [dataclasses.replace(sample, outputs=outputs) for sample in samples]
    assert encode_episode(header, 1, samples).sha256 == GOLDEN_OUTPUTS_SHA256


def test_bytes_of_an_episode_with_labels_do_not_change_between_versions() -> None:
    header, samples = golden_episode()
    label = dataclasses.replace(make_labels(0), box=np.array([2.0, 0.5, 1.0, 0.5, 0.75, 1.75, 0.0]))
    samples = [dataclasses.replace(sample, labels=(label,)) for sample in samples]
    assert encode_episode(dataclasses.replace(header, labels=True), 1, samples).sha256 == GOLDEN_LABELS_SHA256


def test_labels_that_miss_humans_are_refused() -> None:
    header, samples = make_episode(0, 3, labels=True)
    odd = dataclasses.replace(samples[1], labels=())
    with pytest.raises(DatasetError, match="has 0 labels for 1 humans at sample 1; its header says all are labelled"):
        encode_episode(header, 1, [samples[0], odd, samples[2]])
    with pytest.raises(DatasetError, match="has 1 labels for 1 humans at sample 0; its header says none are labelled"):
        encode_episode(dataclasses.replace(header, labels=False), 1, samples)


def test_labels_change_nothing_else_of_an_episode() -> None:
    plain, more = (encode_episode(*_with_attempt(*make_episode(2, 4, labels=labels))) for labels in (False, True))
    assert list(plain.outputs) == []
    assert list(more.outputs) == ["joints", "boxes", "footprints"]
    both = range(1, 9)
    assert [more.message_offsets[n][0][0] for n in both] == [plain.message_offsets[n][0][0] for n in both]
    assert more.samples["pose"].tolist() == plain.samples["pose"].tolist()


def test_outputs_come_back_as_they_went_in() -> None:
    header, samples = make_episode(3, outputs=("mask", "depth"))
    chunk = read_chunk(encode_episode(header, 2, samples).data)
    assert list(chunk.outputs) == ["depth", "mask"]
    for name, places in chunk.outputs.items():
        found = [chunk.data[offset : offset + length] for offset, length in places.tolist()]
        assert found == [sample.outputs[name] for sample in samples]


def test_order_in_which_outputs_are_named_does_not_matter() -> None:
    one, other = (make_episode(0, 3, outputs=names) for names in (("depth", "mask"), ("mask", "depth")))
    assert encode_episode(one[0], 1, one[1]).data == encode_episode(other[0], 1, other[1]).data


def test_samples_with_different_outputs_are_refused() -> None:
    header, samples = make_episode(0, 4, outputs=("depth", "mask"))
    odd = dataclasses.replace(samples[2], outputs={"depth": b""})
    with pytest.raises(DatasetError, match=r"outputs \['depth', 'mask'\] at sample 0, but \['depth'\] at sample 2"):
        encode_episode(header, 1, [*samples[:2], odd, samples[3]])


def test_output_that_misses_samples_is_refused() -> None:
    header, samples = make_episode(0, 3, outputs=("depth",))
    chunk = encode_episode(header, 1, samples)
    offset = chunk.message_offsets[schemas.OUTPUT_CHANNELS["depth"].number][1][1]
    view = memoryview(chunk.data)
    end = next(message.end for message in iter_messages(view, 0, len(view)) if message.offset == offset)
    data = bytes(view[:offset]) + bytes(view[end:])
    with pytest.raises(DatasetError, match="3 samples has 2 messages on /camera/depth"):
        read_chunk(data, sha256=chunk.sha256)


def test_times_are_simulated_and_grow_within_and_between_episodes() -> None:
    times = []
    for index in (0, 1):
        chunk = encode_episode(*_with_attempt(*make_episode(index)))
        view = memoryview(chunk.data)
        times += [message.log_time_ns for message in iter_messages(view, 0, len(view))]
    assert times[0] == 0
    assert times == sorted(times)
    assert times[-1] == 100_000_000_000 + 11 * 50_000_000


def test_missing_samples_are_refused() -> None:
    header, samples = make_episode(0)
    for some in (samples[:-1], samples[1:], ()):
        with pytest.raises(DatasetError, match="has 12 samples, got"):
            encode_episode(header, 1, some)


def test_any_flipped_byte_is_noticed() -> None:
    header, samples = make_episode(0, 2)
    data = encode_episode(header, 1, samples).data
    for offset in range(0, len(data), 7):
        damaged = bytearray(data)
        damaged[offset] ^= 0x10
        try:
            chunk = read_chunk(bytes(damaged))
        except DatasetError:
            continue
        # Left are fields of the commit that the hash does not cover.
        commit_offset = chunk.message_offsets[schemas.EPISODE_COMMIT.number][0][1]
        assert offset >= commit_offset


def _with_attempt(header, samples):
    return header, 1, samples


def _with_expert(samples, count=3):
    """Samples at which an expert was asked that drives itself."""
    actions = [(sample.action_v_mps, sample.action_w_radps) for sample in samples]
    return [
        dataclasses.replace(sample, expert_commands=tuple((actions[k:] + actions[-1:] * count)[:count]))
        for k, sample in enumerate(samples)
    ]


def test_experts_commands_outcome_and_driver_come_back() -> None:
    header, samples = make_episode(0, outcome=Outcome.HUMAN_COLLISION, driver=DriverKind.POLICY)
    chunk = encode_episode(header, 1, _with_expert(samples))
    assert chunk.ending == (Outcome.HUMAN_COLLISION, DriverKind.POLICY, "")
    assert tuple(chunk.outputs) == ("expert",)
    assert len(chunk.outputs["expert"]) == len(samples)


def test_episode_without_the_experts_commands_is_its_success() -> None:
    header, samples = make_episode(0)
    plain = encode_episode(header, 1, samples)
    assert plain.ending == (Outcome.SUCCESS, DriverKind.EXPERT, "")
    assert "expert" not in plain.outputs


def test_episode_with_different_numbers_of_experts_commands_is_refused() -> None:
    header, samples = make_episode(0)
    mixed = _with_expert(samples)
    mixed[2] = samples[2]
    with pytest.raises(DatasetError, match="3 commands of the expert at sample 0, but 0 at sample 2"):
        encode_episode(header, 1, mixed)
