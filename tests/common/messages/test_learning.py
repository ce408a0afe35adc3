import pytest

from readygo.common.messages import (
    ClaimReply,
    ClaimStatus,
    DoneRequest,
    FileRef,
    OfferRequest,
    PolicyFile,
    PolicyRef,
    decode,
    encode,
)


@pytest.mark.parametrize("name", ["", "..", "../policy.onnx", "a/b", "/policy.onnx", ".hidden", "policy onnx"])
def test_name_that_may_lead_out_of_the_policys_folder_is_refused(name: str) -> None:
    with pytest.raises(ValueError, match="must have a plain name"):
        PolicyFile(name=name, data=b"")


def test_files_travel_whole() -> None:
    offer = OfferRequest(files=(PolicyFile(name="policy.onnx", data=bytes(range(256))), PolicyFile(name="a", data=b"")))
    assert decode(OfferRequest, encode(offer)) == offer


def test_hash_of_a_policy_is_over_names_and_contents_in_any_order() -> None:
    a, b = FileRef(path="a", sha256="1" * 64, size=1), FileRef(path="b", sha256="2" * 64, size=1)
    policy = PolicyRef(path="", files=(a, b), mix=0.5)
    assert PolicyRef(path="elsewhere", files=(b, a), mix=0.1).sha256 == policy.sha256
    renamed = FileRef(path="c", sha256="2" * 64, size=1)
    assert PolicyRef(path="", files=(a, renamed), mix=0.5).sha256 != policy.sha256


def test_messages_of_runs_without_policies_are_those_of_before() -> None:
    done = DoneRequest(recorder="r", index=0, attempt=1, shard="s", sample_count=3)
    for message in (ClaimReply(status=ClaimStatus.LEASE), done):
        assert b"policy" not in encode(message)
