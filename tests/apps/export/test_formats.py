import typing

import pytest

from readygo.apps.commands.export import FormatName
from readygo.apps.export import formats
from readygo.common.errors import ConfigError


def test_command_line_names_all_of_them() -> None:
    assert set(typing.get_args(FormatName)) == set(formats.FORMATS)


def test_missing_package_is_named_with_the_command_that_installs_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(formats.importlib.util, "find_spec", lambda name: None)
    formats.FORMATS["webdataset"].check()
    with pytest.raises(ConfigError, match=r"needs pyarrow.*pip install"):
        formats.FORMATS["lerobot"].check()
