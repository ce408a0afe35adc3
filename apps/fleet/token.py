"""The token of a run: who does not know it is refused by the run's router."""

import os
import secrets

TOKEN_VARIABLE = "READYGO_TOKEN"


def new_token() -> str:
    """A token that nobody can guess."""
    return secrets.token_hex(16)


def given_token() -> str:
    """The token that this process was given in its environment, which no other user can read; empty without one."""
    return os.environ.get(TOKEN_VARIABLE, "")


def with_token(token: str) -> dict[str, str]:
    """The environment of a process that shall know the token."""
    return {**os.environ, TOKEN_VARIABLE: token}
