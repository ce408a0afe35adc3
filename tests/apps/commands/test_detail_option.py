import pytest

from readygo.apps.run.config import RunConfig, with_detail
from readygo.common.config import section_from_mapping
from readygo.common.errors import ConfigError


def test_detail_of_the_command_line_takes_the_place_of_the_configurations() -> None:
    assert RunConfig().renderer.detail == "exact"
    coarse = with_detail(RunConfig(), "lod")
    assert coarse.renderer.detail == "lod"
    assert with_detail(coarse, "exact") == RunConfig()


def test_backend_without_levels_of_detail_is_named() -> None:
    config = section_from_mapping(RunConfig, {"renderer": {"backend": "reference"}})
    with pytest.raises(ConfigError, match=r"--detail: .*backend cpu only, got 'reference'"):
        with_detail(config, "lod")
