import dataclasses
import zlib

import pytest

from readygo.common.messages import DriverKind, EpisodeHeader, Outcome, Sample, decode, encode, sample_crc32
from tests.common.dataset.episodes import make_episode, make_header


@pytest.fixture
def sample() -> Sample:
    return make_episode(0, 1, outputs=("depth", "mask"))[1][0]


def test_checksum_of_a_sample_without_outputs_is_that_of_its_image() -> None:
    assert sample_crc32(b"jpeg", {}) == zlib.crc32(b"jpeg")


def test_checksum_does_not_depend_on_the_order_of_the_outputs() -> None:
    assert sample_crc32(b"jpeg", {"depth": b"a", "mask": b"b"}) == sample_crc32(b"jpeg", {"mask": b"b", "depth": b"a"})


def test_sample_is_intact_until_an_image_changes(sample: Sample) -> None:
    assert sample.intact
    depth, mask = sample.outputs["depth"], sample.outputs["mask"]
    flipped = bytes([depth[0] ^ 1]) + depth[1:]
    for outputs in (
        {"depth": flipped, "mask": mask},
        {"depth": mask, "mask": depth},
        {"depth": depth},
        {"median_depth": depth, "mask": mask},
        {},
    ):
        assert not dataclasses.replace(sample, outputs=outputs).intact
    assert not dataclasses.replace(sample, image=b"other").intact


def test_size_counts_all_images(sample: Sample) -> None:
    outputs = sample.outputs
    assert sample.images_size_bytes == len(sample.image) + len(outputs["depth"]) + len(outputs["mask"])


def test_samples_can_be_hashed(sample: Sample) -> None:
    assert len({sample, sample}) == 1


@pytest.mark.parametrize(
    ("model", "count", "message"),
    [
        ("plumb_bob", 4, r"'plumb_bob' has 5 coefficients, got 4"),
        ("kannala_brandt", 5, r"'kannala_brandt' has 4 coefficients, got 5"),
        ("", 1, r"'' has 0 coefficients, got 1"),
        ("equidistant", 4, r"must be one of \['', 'kannala_brandt', 'plumb_bob', 'rational_polynomial'\]"),
    ],
)
def test_distortion_that_viewers_would_not_understand_is_refused(model: str, count: int, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_header(0, 1, distortion_model=model, distortion=(0.1,) * count)


def test_header_is_a_pinhole_camera_by_default() -> None:
    header: EpisodeHeader = make_header(0, 1)
    assert (header.distortion_model, header.distortion) == ("", ())


def test_advice_outcome_and_driver_travel_where_they_say_something_new(sample: Sample) -> None:
    plain = make_header(0, 3)
    assert not any(name in encode(plain) for name in (b"outcome", b"driver"))
    assert b"expert_commands" not in encode(sample)
    failed = dataclasses.replace(plain, outcome=Outcome.HUMAN_COLLISION, driver=DriverKind.POLICY)
    assert decode(EpisodeHeader, encode(failed)) == failed
    advised = dataclasses.replace(sample, expert_commands=((0.5, 0.0), (0.55, 0.1)))
    assert decode(Sample, encode(advised)).expert_commands == advised.expert_commands
