"""The avatars of the renderer's tests."""

import functools

from readygo.common.avatars import Avatar, load_avatars


@functools.cache
def wearers() -> dict[str, Avatar]:
    loaded = load_avatars()
    return {name: loaded[name] for name in sorted(loaded)[:2]}
