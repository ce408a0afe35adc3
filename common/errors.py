"""Exceptions that a user can act on; the command line prints one line of them and exits with code 2."""


class ReadygoError(Exception):
    """A mistake or a state that the user can mend; the message says what is wrong and what to do."""


class ConfigError(ReadygoError):
    """A configuration value or file that cannot be used."""


class SceneError(ReadygoError):
    """A scene, a Gaussian file or a map that cannot be used."""


class AvatarError(ReadygoError):
    """An avatar file that cannot be used."""


class MotionError(ReadygoError):
    """A trajectory or a motion that no person can follow."""


class DatasetError(ReadygoError):
    """A shard, an index or a data folder that cannot be used."""


class PolicyError(ReadygoError):
    """A policy artifact that cannot be used."""


class BusError(ReadygoError):
    """A peer that does not answer, or an endpoint that cannot be opened."""


class RunError(ReadygoError):
    """A run that cannot be started, resumed or finished."""
