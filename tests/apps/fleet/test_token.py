import pytest

from readygo.apps.fleet.token import TOKEN_VARIABLE, given_token, new_token, with_token


def test_token_is_new_every_time_and_travels_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv(TOKEN_VARIABLE, raising=False)
    assert given_token() == ""
    token = new_token()
    assert token != new_token()
    assert len(token) == 32
    environment = with_token(token)
    assert "PATH" in environment
    monkeypatch.setenv(TOKEN_VARIABLE, environment[TOKEN_VARIABLE])
    assert given_token() == token
