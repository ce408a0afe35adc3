from readygo.common.config import section_from_mapping
from readygo.services.reconstructor.config import ReconstructorConfig


def test_sections_are_read_by_name() -> None:
    config = section_from_mapping(ReconstructorConfig, {"frames": {"count_max": 30}, "metric": {"scale": 2.0}})
    assert (config.frames.count_max, config.metric.scale) == (30, 2.0)
    assert config.poses == ReconstructorConfig().poses
