"""Exceptions that a user can act on; the command line prints one line of them and exits with code 2."""

import errno
import os

CANNOT_WORK = os.EX_CONFIG
"""Exit code of a worker that no restart would help: its settings, its data or its disk must be mended."""
NO_ROOM = (errno.ENOSPC, errno.EDQUOT)
"""Error numbers of a full disk."""


class ReadygoError(Exception):
    """A mistake or a state that the user can mend; the message says what is wrong and what to do."""


class ConfigError(ReadygoError):
    """A configuration value or file that cannot be used."""


class SceneError(ReadygoError):
    """A scene, a Gaussian file or a map that cannot be used."""


class NoGroundError(SceneError):
    """A scene in which no agent can move: no floor, none that is large enough, or far too much of it."""


class AvatarError(ReadygoError):
    """An avatar file that cannot be used."""


class MotionError(ReadygoError):
    """A trajectory or a motion that no human can follow."""


class DatasetError(ReadygoError):
    """A shard, an index or a data folder that cannot be used."""


class PolicyError(ReadygoError):
    """A policy artifact that cannot be used."""


class BusError(ReadygoError):
    """A peer that does not answer, or an endpoint that cannot be opened."""


class CertificateError(ReadygoError):
    """A certificate that is missing, cannot be used, or does not allow what is asked."""


class PeerError(BusError):
    """A peer that answered that it cannot do what it was asked; the message names the topic and the reason."""


class MessageError(ReadygoError):
    """Bytes that are no message, or not the one that was due."""


class RunError(ReadygoError):
    """A run that cannot be started, resumed or finished."""


class DiskError(RunError):
    """A disk that takes nothing for now, because it is full or read-only: what is to be written can wait."""


def reason(error: Exception) -> str:
    """What went wrong, in words for a user who sees no traceback."""
    return str(error) if isinstance(error, ReadygoError) else f"{type(error).__name__}: {error}"


def cause(error: Exception) -> str:
    """What an exception says, without the error number and the file that one of the operating system repeats."""
    return (isinstance(error, OSError) and error.strerror) or str(error)


def first_line(error: BaseException) -> str:
    """The first line of what a library's exception says, or the exception's name where it says nothing."""
    lines = str(error).strip().splitlines()
    return lines[0] if lines else type(error).__name__
