import pytest

from readygo.services.reconstructor.poses.config import PosesConfig


def test_numbers_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="threads"):
        PosesConfig(threads=-1)


@pytest.mark.parametrize(("count", "mapper"), [(3, "incremental"), (200, "incremental"), (201, "global")])
def test_many_images_are_mapped_at_once(count: int, mapper: str) -> None:
    assert PosesConfig().mapper_of(count) == mapper
    assert PosesConfig(mapper="incremental").mapper_of(count) == "incremental"
