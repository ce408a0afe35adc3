import pickle
import subprocess
import sys

import numpy as np
import pytest

from readygo.common.dataset import Dataset
from readygo.common.dataset.shard_files import ShardFiles
from readygo.common.errors import DatasetError
from readygo.common.images.images import OUTPUTS
from readygo.common.robot.command_grid import UNKNOWN_RISK, command_grid
from tests import crooked
from tests.common.dataset.episodes import (
    PROVENANCE,
    ROBOT,
    image_number,
    make_episode,
    make_images,
    make_labels,
    write_shard,
)


def test_arrays_hold_every_sample(two_shards) -> None:
    dataset = Dataset([two_shards])
    samples = [sample for index, count in ((0, 12), (2, 30), (4, 12)) for sample in make_episode(index, count)[1]]
    np.testing.assert_array_equal(
        dataset.actions, np.float32([(sample.action_v_mps, sample.action_w_radps) for sample in samples])
    )
    np.testing.assert_array_equal(dataset.goals_xy_m, np.float32([sample.goal_xy_robot_m for sample in samples]))
    np.testing.assert_array_equal(dataset.time_ns, [sample.time_ns for sample in samples])
    np.testing.assert_allclose(dataset.poses, [sample.robot_xyzyaw for sample in samples], atol=1e-12)
    np.testing.assert_array_equal(dataset.truth["human_visible"], [sample.human_visible for sample in samples])
    assert [dataset.image(number) for number in range(54)] == [sample.image for sample in samples]
    assert (dataset.actions.dtype, dataset.goals_xy_m.dtype) == (np.float32, np.float32)


def test_windows_are_oldest_first_and_stay_in_their_episode(two_shards) -> None:
    windows = Dataset([two_shards]).windows([0, 9, 10, 12, 21, 22, 41, 42])
    assert windows.tolist() == [
        [0, 0, 0],
        [0, 0, 9],
        [0, 0, 10],
        [12, 12, 12],
        [12, 12, 21],
        [12, 12, 22],
        [21, 31, 41],
        [42, 42, 42],
    ]


def test_windows_of_all_samples_with_another_spacing(two_shards) -> None:
    windows = Dataset([two_shards]).windows(spacing_s=0.05)
    assert windows.shape == (54, 3)
    assert windows[[0, 1, 53]].tolist() == [[0, 0, 0], [0, 0, 1], [51, 52, 53]]
    with pytest.raises(ValueError, match=r"multiple of 0\.05 s"):
        Dataset([two_shards]).windows(spacing_s=0.07)


def test_shard_layout_does_not_show(tmp_path) -> None:
    write_shard(tmp_path / "one", [0, 1, 2])
    write_shard(tmp_path / "many", [2], number=0, recorder="r1")
    write_shard(tmp_path / "many", [1], number=7, recorder="r0")
    write_shard(tmp_path / "many", [0], number=8, recorder="r0")
    one, many = Dataset([tmp_path / "one"]), Dataset([tmp_path / "many"])
    assert [entry.sha256 for entry in one.episodes] == [entry.sha256 for entry in many.episodes]
    np.testing.assert_array_equal(one.actions, many.actions)
    assert [one.image(number) for number in range(36)] == [many.image(number) for number in range(36)]
    assert one.content_hash == many.content_hash


def test_content_hash_changes_with_the_content(tmp_path) -> None:
    write_shard(tmp_path / "a", [0, 1])
    write_shard(tmp_path / "b", [0, 2])
    assert Dataset([tmp_path / "a"]).content_hash != Dataset([tmp_path / "b"]).content_hash


def test_provenance_and_robot_come_with_the_data(two_shards) -> None:
    dataset = Dataset([two_shards])
    assert dataset.provenance == PROVENANCE
    assert dataset.robot == ROBOT


def test_open_shards_are_left_out(two_shards) -> None:
    (two_shards / "shard-r0-00002.mcap.part").write_bytes(b"half of something")
    assert len(Dataset([two_shards])) == 54


@pytest.mark.parametrize("cut", [1, 8, 30, 3000])
def test_truncated_shard_is_named(two_shards, cut) -> None:
    shard = two_shards / "shard-r0-00001.mcap"
    shard.write_bytes(shard.read_bytes()[:-cut])
    with pytest.raises(DatasetError, match=r"shard-r0-00001\.mcap is truncated"):
        Dataset([two_shards])


def test_empty_shard_is_named(two_shards) -> None:
    (two_shards / "shard-r0-00001.mcap").write_bytes(b"")
    with pytest.raises(DatasetError, match=r"shard-r0-00001\.mcap cannot be read"):
        Dataset([two_shards])


def test_dataset_travels_to_other_processes(two_shards) -> None:
    dataset = Dataset([two_shards])
    image = dataset.image(0)
    copied = pickle.loads(pickle.dumps(dataset))
    assert copied.image(0) == image
    dataset.close()
    assert dataset.image(0) == image


def overwrite(shard, offset, data) -> None:
    with shard.open("r+b") as file:
        file.seek(offset)
        file.write(data)


@pytest.mark.parametrize("place", range(0, 100, 9))
def test_any_flipped_bit_of_an_episode_is_noticed_at_its_first_use(place, tmp_path) -> None:
    shard = write_shard(tmp_path, [0, 1], outputs=("depth",), labels=True)
    files = Dataset(tmp_path)._files
    files.is_sound(0, 0)
    span = files._spans[0][0]
    offset = span.body + place * (span.end - span.body - 1) // 99
    overwrite(shard, offset, bytes([shard.read_bytes()[offset] ^ 1 << place % 8]))
    dataset = Dataset(tmp_path)
    for use in (dataset.image, dataset.decode, dataset.joints_m, lambda index: dataset.output(index, "depth")):
        with pytest.raises(DatasetError, match=r"Episode train-7-000000 in .*shard-r0-00000\.mcap is damaged"):
            use(3)
    assert dataset.decode(20).shape == (24, 32, 3), "other episodes are as they were"
    with pytest.raises(DatasetError, match=r"shard-r0-00000\.mcap is damaged"):
        dataset.humans_of(0)
    assert len(dataset.humans_of(1)) == dataset.episodes[1].sample_count


def test_shard_that_cannot_be_followed_is_damaged_from_there_on(tmp_path) -> None:
    shard = write_shard(tmp_path, [0, 1, 2])
    files = Dataset(tmp_path)._files
    files.is_sound(0, 1)
    # The length of the second chunk.
    overwrite(shard, files._spans[0][1].body - 48, b"\xff" * 4)
    dataset = Dataset(tmp_path)
    per_episode = len(dataset) // 3
    assert dataset.image(0)
    for number in (1, 2):
        with pytest.raises(DatasetError, match=rf"Episode train-7-00000{number} in .* is damaged"):
            dataset.image(number * per_episode)


def test_an_episode_is_checked_once(two_shards, monkeypatch) -> None:
    checked = []
    sound = ShardFiles.is_sound
    monkeypatch.setattr(ShardFiles, "is_sound", lambda *where: checked.append(where[1:]) or sound(*where))
    dataset = Dataset(two_shards)
    random = np.random.default_rng(0)
    for index in random.integers(len(dataset), size=200).tolist():
        dataset.image(index)
    assert sorted(checked) == sorted(set(dataset._order))
    dataset.close()
    copied = pickle.loads(pickle.dumps(dataset))
    copied.image(0)
    assert len(checked) == len(dataset.episodes), "what was checked is known to a copy as well"


def test_damaged_image_is_named(tmp_path) -> None:
    shard = write_shard(tmp_path, [0])
    dataset = Dataset([tmp_path])
    dataset.image(0)
    overwrite(shard, int(dataset._table.rows[3]["image_offset"]), bytes(100))
    with pytest.raises(DatasetError, match=r"image of sample 3 in .*shard-r0-00000\.mcap is damaged"):
        dataset.decode(3)


def test_import_loads_no_opencv() -> None:
    code = "import sys, common.dataset; sys.exit(any(name in sys.modules for name in ('cv2', 'torch', 'zenoh')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_any_output_of_any_sample_can_be_read(two_rich_shards) -> None:
    dataset = Dataset([two_rich_shards])
    assert dataset.outputs == ("rgb", "depth", "mask")
    samples = [s for index, n in ((0, 5), (2, 4), (4, 5)) for s in make_episode(index, n, outputs=("depth", "mask"))[1]]
    for number in np.random.default_rng(0).permutation(len(samples)).tolist():
        for name in ("depth", "mask"):
            assert dataset.output(number, name) == samples[number].outputs[name]
        assert dataset.output(number, "rgb") == dataset.image(number) == samples[number].image


def test_depth_is_decoded_to_metres_and_the_mask_to_humans(two_rich_shards) -> None:
    dataset = Dataset([two_rich_shards])
    for number, (index, seq) in ((0, (0, 0)), (7, (2, 2)), (13, (4, 4))):
        images = make_images(image_number(index, seq))
        depth_m, mask = dataset.decode_output(number, "depth"), dataset.decode_output(number, "mask")
        assert (depth_m.dtype, mask.dtype) == (np.float32, np.uint8)
        np.testing.assert_array_equal(np.isinf(depth_m), np.isinf(images.depth_m))
        np.testing.assert_allclose(depth_m, images.depth_m, atol=0.000505)
        np.testing.assert_array_equal(mask, images.mask)
    np.testing.assert_array_equal(dataset.decode_output(3, "rgb"), dataset.decode(3))


def test_all_outputs_can_be_recorded_together(tmp_path) -> None:
    write_shard(tmp_path, [0], outputs=OUTPUTS[1:], sample_count=2)
    dataset = Dataset([tmp_path])
    assert dataset.outputs == OUTPUTS
    shapes = {name: dataset.decode_output(1, name).shape for name in dataset.outputs}
    assert shapes == dict.fromkeys(OUTPUTS, (24, 32)) | dict.fromkeys(("rgb", "normal"), (24, 32, 3))


def test_output_that_some_samples_lack_is_refused_by_name(two_rich_shards) -> None:
    dataset = Dataset([two_rich_shards])
    for name in ("alpha", "thermal"):
        with pytest.raises(DatasetError, match=rf"have no '{name}' images, they have rgb, depth, mask; record others"):
            dataset.decode_output(0, name)


def test_outputs_do_not_change_what_else_is_read(tmp_path) -> None:
    write_shard(tmp_path / "plain", [0, 1])
    write_shard(tmp_path / "more", [0, 1], outputs=("depth", "mask", "normal"))
    plain, more = Dataset([tmp_path / "plain"]), Dataset([tmp_path / "more"])
    assert plain.outputs == ("rgb",)
    np.testing.assert_array_equal(plain.actions, more.actions)
    np.testing.assert_array_equal(plain.poses, more.poses)
    np.testing.assert_array_equal(plain.windows(), more.windows())
    assert [plain.image(number) for number in range(24)] == [more.image(number) for number in range(24)]


def test_pickled_dataset_reads_outputs(two_rich_shards) -> None:
    dataset = Dataset([two_rich_shards])
    assert pickle.loads(pickle.dumps(dataset)).output(6, "mask") == dataset.output(6, "mask")


def test_damaged_output_is_named(tmp_path) -> None:
    shard = write_shard(tmp_path, [0], outputs=("depth",))
    dataset = Dataset([tmp_path])
    dataset.image(0)
    overwrite(shard, int(dataset._table.payloads["depth"][3]["offset"]), bytes(100))
    with pytest.raises(DatasetError, match=r"depth image of sample 3 in .*shard-r0-00000\.mcap is damaged"):
        dataset.decode_output(3, "depth")


def test_labels_of_any_sample_can_be_read(tmp_path) -> None:
    write_shard(tmp_path, [4, 0], labels=True, outputs=("mask",), sample_count=5)
    dataset = Dataset([tmp_path])
    assert (dataset.outputs, dataset.labels) == (("rgb", "mask"), ("joints", "boxes", "footprints"))
    for number in (0, 3, 9, 5):
        want = make_labels(number % 5)
        np.testing.assert_array_equal(dataset.joints_m(number), [want.joints_m])
        np.testing.assert_allclose(dataset.boxes(number), [want.box], atol=1e-12)
        assert [ground.tolist() for ground in dataset.footprints_xy_m(number)] == [want.footprint_xy_m.tolist()]
    assert pickle.loads(pickle.dumps(dataset)).joints_m(2).shape == (1, 24, 3)


def test_sizes_are_those_of_the_images(tmp_path) -> None:
    write_shard(tmp_path, [0])
    dataset = Dataset([tmp_path])
    assert dataset.image_sizes.tolist() == [len(dataset.image(index)) for index in range(len(dataset))]


def test_labels_that_some_shards_lack_are_refused(tmp_path) -> None:
    write_shard(tmp_path, [0], labels=True)
    write_shard(tmp_path, [1], number=1)
    dataset = Dataset([tmp_path])
    assert dataset.labels == ()
    with pytest.raises(DatasetError, match=r"have no labels of people; record with labels = true"):
        dataset.boxes(0)


@pytest.mark.parametrize("robot", [crooked.ROBOT, crooked.ODD_RATES], ids=["20 Hz", "30 Hz"])
def test_everything_of_a_crooked_robot_comes_back(tmp_path, robot) -> None:
    crooked.write_crooked_shard(tmp_path, (8, 3), 13, robot=robot)
    dataset = Dataset(tmp_path)
    episodes = [crooked.crooked_episode(index, 13, robot=robot) for index in (3, 8)]
    samples = [sample for _, of_episode in episodes for sample in of_episode]
    pictured = [bool(sample.image) for sample in samples]
    nothing = np.full((crooked.EXPERT_AHEAD, 2), np.nan)
    expert = [sample.expert_commands if sample.image else nothing for sample in samples]
    command_count = len(command_grid(robot))
    risks = [list(sample.risks) if sample.image else [UNKNOWN_RISK] * command_count for sample in samples]
    assert len(dataset) == 26
    assert dataset.clock == robot.clock
    assert dataset.pictured.tolist() == pictured
    assert dataset.time_ns.tolist() == [sample.time_ns for sample in samples]
    assert dataset.image_sizes.tolist() == [len(sample.image) for sample in samples]
    np.testing.assert_array_equal(dataset.actions, np.float32([(s.action_v_mps, s.action_w_radps) for s in samples]))
    np.testing.assert_array_equal(dataset.goals_xy_m, np.float32([s.goal_xy_robot_m for s in samples]))
    np.testing.assert_allclose(dataset.poses, [s.robot_xyzyaw for s in samples], atol=1e-12)
    np.testing.assert_allclose(np.concatenate([dataset.expert_actions[:, None], dataset.expert_ahead], axis=1), expert)
    assert dataset.risks.tolist() == risks
    for name in ("human_distance_m", "time_to_collision_s", "human_visible", "expert_cost", "replanned"):
        np.testing.assert_allclose(dataset.truth[name], [getattr(s, name) for s in samples], rtol=1e-6, err_msg=name)
    for row, sample in enumerate(samples):
        np.testing.assert_allclose(dataset.humans_xyzyaw[row], sample.humans_xyzyaw, atol=1e-12)
        assert dataset.image(row) == sample.image
        if sample.image:
            assert {name: dataset.output(row, name) for name in sample.outputs} == sample.outputs
    np.testing.assert_allclose(np.array(dataset.humans_of(1)), [s.humans_xyzyaw for s in episodes[1][1]], atol=1e-12)
    for number, (entry, (header, _)) in enumerate(zip(dataset.episodes, episodes, strict=True)):
        assert (entry.episode, entry.first_sample, entry.sample_count) == (header.episode, 13 * number, 13)
        assert (entry.outcome, entry.driver, entry.policy) == (header.outcome, header.driver, header.policy)
        assert entry.attempt == 2


def test_cameras_of_a_crooked_robot_come_back(tmp_path) -> None:
    crooked.write_crooked_shard(tmp_path, (3, 8), 5)
    dataset = Dataset(tmp_path)
    for camera, name in ((crooked.CAMERA, ""), (crooked.LEFT, "left")):
        found = dataset.calibration(7, name)
        assert (found.height_px, found.width_px) == (camera.height_px, camera.width_px)
        np.testing.assert_allclose(found.K_px, camera.K_px)
        image = dataset.decode_output(7, f"{name}.rgb" if name else "rgb")
        assert image.shape == (camera.height_px, camera.width_px, 3)
        depth_m = dataset.decode_output(7, f"{name}.depth" if name else "depth")
        assert depth_m.shape == (camera.height_px, camera.width_px)


def test_windows_follow_the_clock_and_the_pictures_of_a_crooked_robot(tmp_path) -> None:
    crooked.write_crooked_shard(tmp_path, (3, 8), 21, robot=crooked.ODD_RATES)
    dataset = Dataset(tmp_path)
    # 0.2 s are 6 steps of 1/30 s; images are at even steps.
    windows = dataset.windows([20, 17, 13, 12, 21, 22, 41], spacing_s=0.2)
    assert windows.tolist() == [
        [8, 14, 20], [4, 10, 16], [0, 6, 12], [0, 6, 12], [21, 21, 21], [21, 21, 21], [29, 35, 41],
    ]  # fmt: skip
    with pytest.raises(ValueError, match=r"multiple of 0\.0666667 s"):
        dataset.windows(spacing_s=0.1)
