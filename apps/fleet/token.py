"""The token of a run: the run's router rejects processes without it."""

import os
import secrets

TOKEN_VARIABLE = "READYGO_TOKEN"


def new_token() -> str:
    """A new random token of 128 bits, in hexadecimal."""
    return secrets.token_hex(16)


def given_token() -> str:
    """The token in this process's environment, which other users cannot read; empty without one."""
    return os.environ.get(TOKEN_VARIABLE, "")


def with_token(token: str) -> dict[str, str]:
    """This process's environment with the token, for a child process."""
    return {**os.environ, TOKEN_VARIABLE: token}
