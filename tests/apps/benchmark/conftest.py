from pathlib import Path

import pytest

from readygo.apps.benchmark.drive import SuiteDrive, drive_suite
from readygo.runs.benchmark.suite import OpenSuite
from tests.runs.benchmark.suites import small_suite

DRIVERS = ("straight-line", "expert-oracle")


@pytest.fixture(scope="session")
def suite(tmp_path_factory: pytest.TempPathFactory) -> OpenSuite:
    return small_suite(tmp_path_factory.mktemp("suite"))


@pytest.fixture(scope="session")
def driven(suite: OpenSuite, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Results of two drivers in all episodes of a small suite; tests that change them copy the folder."""
    folder = tmp_path_factory.mktemp("driven")
    drive_suite(SuiteDrive(suite=suite, drivers=DRIVERS, folder=folder, checkpoints=folder), report=lambda _: None)
    return folder
