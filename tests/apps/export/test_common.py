from readygo.apps.export.common import suffix
from tests.common.dataset.episodes import jpeg


def test_ending_follows_from_the_bytes() -> None:
    assert suffix(jpeg(0)) == "jpg"
    assert suffix(b"\x89PNG\r\n") == "png"
