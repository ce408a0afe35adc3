import copy
import dataclasses
import pickle
import subprocess
import sys

import numpy as np
import pytest

from readygo.common.dataset import Dataset
from readygo.common.dataset.index import build_index, index_path, load_index, mapped, read_index
from readygo.common.errors import DatasetError
from readygo.common.images.images import OUTPUTS
from tests.common.dataset.episodes import (
    PROVENANCE,
    ROBOT,
    image_number,
    jpeg,
    make_episode,
    make_images,
    make_labels,
    provenance_with_robot,
    write_shard,
)


@pytest.fixture
def folder(tmp_path):
    write_shard(tmp_path, [4, 0], number=0)
    write_shard(tmp_path, [2], number=1, sample_count=30)
    return tmp_path


def test_episodes_come_in_order_of_their_index(folder) -> None:
    dataset = Dataset([folder])
    entries = dataset.episodes
    assert [(entry.episode.index, entry.first_sample, entry.sample_count) for entry in entries] == [
        (0, 0, 12),
        (2, 12, 30),
        (4, 42, 12),
    ]
    assert [entry.shard.name for entry in entries] == [f"shard-r0-0000{number}.mcap" for number in (0, 1, 0)]
    assert len(dataset) == 54


def test_arrays_hold_every_sample(folder) -> None:
    dataset = Dataset([folder])
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


def test_decoded_image_is_rgb(tmp_path) -> None:
    import cv2

    write_shard(tmp_path, [0])
    dataset = Dataset([tmp_path])
    image = dataset.decode(3)
    assert (image.shape, image.dtype) == ((24, 32, 3), np.uint8)
    bgr = cv2.imdecode(np.frombuffer(jpeg(3), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(image, bgr[..., ::-1])


def test_windows_are_oldest_first_and_stay_in_their_episode(folder) -> None:
    windows = Dataset([folder]).windows([0, 9, 10, 12, 21, 22, 41, 42])
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


def test_windows_of_all_samples_with_another_spacing(folder) -> None:
    windows = Dataset([folder]).windows(spacing_s=0.05)
    assert windows.shape == (54, 3)
    assert windows[[0, 1, 53]].tolist() == [[0, 0, 0], [0, 0, 1], [51, 52, 53]]
    with pytest.raises(ValueError, match=r"multiple of 0\.05 s"):
        Dataset([folder]).windows(spacing_s=0.07)


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


def test_provenance_and_robot_come_with_the_data(folder) -> None:
    dataset = Dataset([folder])
    assert dataset.provenance == PROVENANCE
    assert dataset.robot == ROBOT


def test_missing_or_stale_index_is_made_again(folder) -> None:
    shard = folder / "shard-r0-00000.mcap"
    want = index_path(shard).read_bytes()
    for content in (None, b"", b"damaged", index_path(folder / "shard-r0-00001.mcap").read_bytes()):
        index_path(shard).unlink()
        if content is not None:
            index_path(shard).write_bytes(content)
        assert len(Dataset([folder])) == 54
        assert index_path(shard).read_bytes() == want


def test_index_of_a_changed_shard_of_the_same_size_is_not_used(folder) -> None:
    shard = folder / "shard-r0-00000.mcap"
    index = index_path(shard).read_bytes()
    size = shard.stat().st_size
    write_shard(folder, [4, 0], number=0, goal_xy_m=(3.0, 1.0))
    index_path(shard).write_bytes(index)
    assert shard.stat().st_size == size
    assert Dataset([folder]).goals_xy_m[0] == pytest.approx(make_episode(0, goal_xy_m=(3.0, 1.0))[1][0].goal_xy_robot_m)


def test_dataset_without_indexes_in_a_folder_that_cannot_be_written(folder, monkeypatch) -> None:
    for path in folder.glob("*.index"):
        path.unlink()

    def refuse(*arguments: object, **options: object) -> None:
        raise PermissionError("read-only file system")

    monkeypatch.setattr("readygo.common.dataset.index.write_index", refuse)
    assert len(Dataset([folder])) == 54


def test_written_index_equals_the_rebuilt_one(folder) -> None:
    shard = folder / "shard-r0-00001.mcap"
    with mapped(shard) as view:
        rebuilt = build_index(view, shard)
    stored = read_index(index_path(shard))
    assert stored is not None
    assert stored.equals(rebuilt)
    assert load_index(shard).equals(rebuilt)


def test_missing_folder_and_folder_without_shards_are_named(tmp_path) -> None:
    with pytest.raises(DatasetError, match="nowhere does not exist; record one"):
        Dataset([tmp_path / "nowhere"])
    with pytest.raises(DatasetError, match="holds no finished shards"):
        Dataset([tmp_path])
    (tmp_path / "shard-r0-00000.mcap.part").write_bytes(b"")
    with pytest.raises(DatasetError, match="1 are still being written"):
        Dataset([tmp_path])


def test_open_shards_are_left_out(folder) -> None:
    (folder / "shard-r0-00002.mcap.part").write_bytes(b"half of something")
    assert len(Dataset([folder])) == 54


@pytest.mark.parametrize("cut", [1, 8, 30, 3000])
def test_truncated_shard_is_named(folder, cut) -> None:
    shard = folder / "shard-r0-00001.mcap"
    shard.write_bytes(shard.read_bytes()[:-cut])
    with pytest.raises(DatasetError, match=r"shard-r0-00001\.mcap is truncated"):
        Dataset([folder])


def test_empty_shard_is_named(folder) -> None:
    (folder / "shard-r0-00001.mcap").write_bytes(b"")
    with pytest.raises(DatasetError, match=r"shard-r0-00001\.mcap cannot be read"):
        Dataset([folder])


def test_mixed_image_sizes_are_refused_with_both(folder) -> None:
    write_shard(folder, [9], number=9, height_px=16, width_px=20)
    with pytest.raises(DatasetError, match=r"24x32 in .*00000.mcap, 16x20 in .*00009.mcap"):
        Dataset([folder])


def test_mixed_robots_are_refused_with_both(folder) -> None:
    write_shard(folder, [9], number=9, provenance=provenance_with_robot(v_max_mps=0.7))
    with pytest.raises(DatasetError, match=r"Robots differ: v_max_mps 1\.0 and 0\.7 in .*00000.mcap and .*00009.mcap"):
        Dataset([folder])


def test_mixed_sensors_are_refused_with_both(folder) -> None:
    config = {**PROVENANCE.config, "renderer": {"sensor": {"exposure_ev": [-0.3, 0.3]}}}
    write_shard(folder, [9], number=9, provenance=dataclasses.replace(PROVENANCE, config=config))
    with pytest.raises(DatasetError, match=r"Sensors differ: exposure_ev \[\] and \[-0\.3, 0\.3\] in .*00000.mcap and"):
        Dataset([folder])


def test_shard_of_before_the_camera_was_one_section_goes_with_one_of_today(folder) -> None:
    config = copy.deepcopy(dict(PROVENANCE.config))
    camera = config["robot"]["camera"]
    optics = {name: camera.pop(name) for name in ("distortion", "k1", "exposure_s")}
    config["renderer"] = {"sensor": {**optics, "sub_frames": 8, "ranges": {"k1": []}}}
    write_shard(folder, [9], number=9, provenance=dataclasses.replace(PROVENANCE, config=config))
    assert Dataset([folder]).robot == ROBOT


def test_folder_given_twice_is_refused(folder) -> None:
    with pytest.raises(DatasetError, match="train-7-000000 is there twice"):
        Dataset([folder, folder])


def test_dataset_travels_to_other_processes(folder) -> None:
    dataset = Dataset([folder])
    image = dataset.image(0)
    copied = pickle.loads(pickle.dumps(dataset))
    assert copied.image(0) == image
    dataset.close()
    assert dataset.image(0) == image


def test_more_shards_than_may_be_open(tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("readygo.common.dataset.reader.OPEN_SHARDS_MAX", 2)
    for number in range(4):
        write_shard(tmp_path, [number], number=number, sample_count=2)
    dataset = Dataset([tmp_path])
    assert [dataset.image(number) for number in (0, 2, 4, 6, 0)] == [jpeg(n) for n in (0, 1000, 2000, 3000, 0)]
    assert len(dataset._maps) == 2


def test_damaged_image_is_named(tmp_path) -> None:
    shard = write_shard(tmp_path, [0])
    dataset = Dataset([tmp_path])
    data = bytearray(shard.read_bytes())
    offset = int(dataset._rows[3]["image_offset"])
    data[offset : offset + 100] = bytes(100)
    shard.write_bytes(data)
    with pytest.raises(DatasetError, match=r"image of sample 3 in .*shard-r0-00000\.mcap is damaged"):
        dataset.decode(3)


def test_import_loads_no_opencv() -> None:
    code = "import sys, common.dataset; sys.exit(any(name in sys.modules for name in ('cv2', 'torch', 'zenoh')))"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


@pytest.fixture
def with_outputs(tmp_path):
    write_shard(tmp_path, [4, 0], number=0, outputs=("depth", "mask"), sample_count=5)
    write_shard(tmp_path, [2], number=1, outputs=("mask", "depth", "alpha"), sample_count=4)
    return tmp_path


def test_any_output_of_any_sample_can_be_read(with_outputs) -> None:
    dataset = Dataset([with_outputs])
    assert dataset.outputs == ("rgb", "depth", "mask")
    samples = [s for index, n in ((0, 5), (2, 4), (4, 5)) for s in make_episode(index, n, outputs=("depth", "mask"))[1]]
    for number in np.random.default_rng(0).permutation(len(samples)).tolist():
        for name in ("depth", "mask"):
            assert dataset.output(number, name) == samples[number].outputs[name]
        assert dataset.output(number, "rgb") == dataset.image(number) == samples[number].image


def test_depth_is_decoded_to_metres_and_the_mask_to_humans(with_outputs) -> None:
    dataset = Dataset([with_outputs])
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


def test_output_that_some_samples_lack_is_refused_by_name(with_outputs) -> None:
    dataset = Dataset([with_outputs])
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


def test_index_with_outputs_is_made_again_as_it_was(with_outputs) -> None:
    shard = with_outputs / "shard-r0-00001.mcap"
    stored, want = read_index(index_path(shard)), index_path(shard).read_bytes()
    index_path(shard).unlink()
    assert stored is not None
    assert list(stored.outputs) == ["depth", "alpha", "mask"]
    assert load_index(shard).equals(stored)
    assert index_path(shard).read_bytes() == want


def test_indexes_that_differ_in_the_place_of_an_output_are_not_equal(with_outputs) -> None:
    index = load_index(with_outputs / "shard-r0-00000.mcap")
    other = copy.deepcopy(index)
    assert index.equals(other)
    other.outputs["mask"]["offset"][3] += 1
    assert not index.equals(other)
    del other.outputs["mask"]
    assert not index.equals(other)


def test_pickled_dataset_reads_outputs(with_outputs) -> None:
    dataset = Dataset([with_outputs])
    assert pickle.loads(pickle.dumps(dataset)).output(6, "mask") == dataset.output(6, "mask")


def test_damaged_output_is_named(tmp_path) -> None:
    shard = write_shard(tmp_path, [0], outputs=("depth",))
    dataset = Dataset([tmp_path])
    data = bytearray(shard.read_bytes())
    offset = int(dataset._output_rows["depth"][3]["offset"])
    data[offset : offset + 100] = bytes(100)
    shard.write_bytes(data)
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


def test_humans_are_known_without_labels_in_the_order_of_the_samples(tmp_path) -> None:
    write_shard(tmp_path, [4, 1], number=0)
    write_shard(tmp_path, [2], number=1)
    dataset = Dataset([tmp_path])
    wanted = [sample.humans_xyzyaw for index in (1, 2, 4) for sample in make_episode(index)[1]]
    assert len(dataset.humans_xyzyaw) == len(dataset) == len(wanted)
    for got, want in zip(dataset.humans_xyzyaw, wanted, strict=True):
        np.testing.assert_allclose(got, np.reshape(want, (-1, 4)), atol=1e-12)
    assert any(len(poses) for poses in dataset.humans_xyzyaw)
    for number, entry in enumerate(dataset.episodes):
        rows = slice(entry.first_sample, entry.first_sample + entry.sample_count)
        for alone, among_all in zip(dataset.humans_of(number), dataset.humans_xyzyaw[rows], strict=True):
            np.testing.assert_array_equal(alone, among_all)


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


def test_calibration_is_that_of_the_episode(tmp_path) -> None:
    coefficients = (0.1, -0.2, 0.3, 0.4, 0.5)
    write_shard(tmp_path, [0], distortion_model="plumb_bob", distortion=coefficients)
    write_shard(tmp_path, [1], number=1)
    dataset = Dataset([tmp_path])
    lens, pinhole = dataset.calibration(3), dataset.calibration(20)
    assert (lens.distortion_model, lens.distortion) == ("plumb_bob", coefficients)
    assert (pinhole.distortion_model, pinhole.distortion) == ("", ())
    assert (lens.height_px, lens.width_px) == (24, 32)
    assert dataset.robot is not None
    np.testing.assert_array_equal(pinhole.K_px, dataset.robot.camera.K_px)
