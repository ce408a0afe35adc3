"""Who may do what, at a real router and in the handlers behind it."""

import dataclasses
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

pytest.importorskip("cryptography", reason="needs the extra tls")

from readygo.common.bus import zenoh_bus
from readygo.common.bus.identity import ALL, OPERATOR, RECORDER
from readygo.common.bus.rights import access_control, refusal
from readygo.common.bus.zenoh_bus import ZenohBus
from readygo.common.errors import BusError, PeerError
from readygo.common.messages import (
    BlobReply,
    ClaimReply,
    ClaimRequest,
    ClaimStatus,
    Command,
    ControlRequest,
    DoneRequest,
    PendingReply,
    PendingRequest,
    RunSpecRequest,
    Verdict,
    VerdictStatus,
    encode,
    topics,
)
from readygo.common.messages.topics import Stream
from tests.common.bus.certified import certificates, certified_router, identity
from tests.common.messages.run_specs import SPEC

Join = Callable[[str], ZenohBus]
OK = Verdict(status=VerdictStatus.OK)
NEWS = Stream("live/progress", BlobReply)
CANCEL = ControlRequest(command=Command.CANCEL)
DONE = DoneRequest(recorder="rec0", index=0, attempt=1, shard="s", sample_count=1)
EVERYBODY = ("coordinator", "renderer", "all", "recorder.rec0", "recorder.rec1", "monitor", "operator", "trainer")


@pytest.fixture(scope="module")
def certs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certs")
    certificates(folder, *EVERYBODY)
    return folder


@pytest.fixture(scope="module")
def fleet(certs: Path) -> Iterator[tuple[str, Join]]:
    with certified_router(certs) as (endpoint, join):
        coordinator = join("coordinator")
        coordinator.serve(topics.SPEC, lambda _: SPEC)
        coordinator.serve(topics.CONTROL, lambda _: OK, by=(OPERATOR,))
        claims = ClaimReply(status=ClaimStatus.WAIT)
        coordinator.serve(topics.claim("render"), lambda _: claims, by=("renderer", ALL))
        coordinator.serve(topics.DONE, lambda _: OK, by=(RECORDER,))
        coordinator.serve(topics.PENDING, lambda _: PendingReply(indices=(1,)), by=(RECORDER,))
        yield endpoint, join


@pytest.fixture
def join(fleet: tuple[str, Join]) -> Join:
    return fleet[1]


def test_everybody_has_the_rights_of_their_role(join: Join) -> None:
    assert join("operator").request(topics.CONTROL, CANCEL) == OK
    for name in ("renderer", "all"):
        reply = join(name).request(topics.claim("render"), ClaimRequest(worker="w", numeric_class="this"))
        assert reply.status is ClaimStatus.WAIT
    recorder = join("recorder.rec0")
    assert recorder.request(topics.DONE, DONE) == OK
    recorder.serve(topics.append("rec0"), lambda _: pytest.fail("nobody asks"))
    recorder.announce("recorder", "rec0")
    assert recorder.request(topics.SPEC, RunSpecRequest(role="recorder")) == SPEC


def test_handlers_refuse_a_wrong_role_in_one_line_and_log_it(join: Join, caplog: pytest.LogCaptureFixture) -> None:
    words = "ctl: refused: a certificate of 'monitor' does not allow that; it takes one of operator."
    for name in ("monitor", "renderer", "recorder.rec0", "trainer"):
        with pytest.raises(PeerError) as error:
            join(name).request(topics.CONTROL, CANCEL)
        assert str(error.value) == words.replace("monitor", name)
    assert "readygo/test/by/monitor/ctl: refused" in caplog.text
    with pytest.raises(
        PeerError, match="a certificate of 'monitor' does not allow that; it takes one of renderer, all"
    ):
        join("monitor").request(topics.claim("render"), ClaimRequest(worker="w"))
    with pytest.raises(PeerError, match="a certificate of 'monitor' does not allow to join as renderer"):
        join("monitor").request(topics.SPEC, RunSpecRequest(role="renderer"))
    with pytest.raises(PeerError, match=r"a certificate of 'recorder\.rec1' does not speak for another recorder"):
        join("recorder.rec1").request(topics.PENDING, PendingRequest(recorder="rec0"))


def test_router_lets_nothing_through_that_is_not_of_a_role(join: Join) -> None:
    for name in ("renderer", "monitor", "operator"):
        with pytest.raises(BusError, match="No participant answered"):
            join(name).request(topics.DONE, DONE, timeout_s=0.3)
    # Nobody asks under the name of another.
    forged = join("renderer")
    for asker in ("operator", "*", "recorder.rec0"):
        key = f"readygo/test/by/{asker}/{topics.CONTROL.name}"
        assert list(forged._session.get(key, payload=encode(CANCEL), attachment=b"ctl", timeout=2.0)) == []
    # Nobody but the coordinator answers for it.
    forged.serve(topics.OFFER, lambda _: pytest.fail("it took a trainer's policy"))
    with pytest.raises(BusError, match="No participant answered"):
        join("trainer").request(topics.OFFER, _offer(), timeout_s=0.5)


def _offer():  # type: ignore[no-untyped-def]
    from readygo.common.messages import OfferRequest, PolicyFile

    return OfferRequest(files=(PolicyFile(name="policy.toml", data=b""),))


def test_monitor_hears_and_cannot_be_heard(join: Join) -> None:
    heard: list[int] = []
    monitor, coordinator, other = join("monitor"), join("coordinator"), join("operator")
    monitor.subscribe(NEWS, lambda message: heard.append(message.size))
    other.subscribe(NEWS, lambda message: heard.append(message.size))
    deadline_s = time.monotonic() + 20.0
    while len(heard) < 2 and time.monotonic() < deadline_s:
        coordinator.publish(NEWS, BlobReply(size=1, data=b""))
        time.sleep(0.02)
    assert set(heard) == {1}
    heard.clear()
    forger = join("monitor")
    for _ in range(5):
        forger._session.put("readygo/test/live/progress", encode(BlobReply(size=2, data=b"")))
    time.sleep(0.3)
    assert 2 not in heard


def test_who_shows_no_certificate_or_one_that_is_not_good_is_refused_and_logged(
    fleet: tuple[str, Join],
    certs: Path,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    endpoint, _ = fleet
    certificates(certs, "animator", days=1e-9)
    certificates(tmp_path, "operator")
    expired = identity(certs, "animator")
    # Times in certificates are whole seconds.
    time.sleep(1.1)
    foreign = dataclasses.replace(identity(tmp_path, "operator"), authority=certs / "ca.pem")
    for wrong in (expired, foreign):
        with pytest.raises(
            BusError, match=rf"or it refuses the certificate .*{wrong.name}\.pem or shows one for another"
        ):
            ZenohBus(endpoint, "test", identity=wrong)
    monkeypatch.setattr(zenoh_bus, "_tls_settings", lambda _: {"transport/link/tls/root_ca_certificate": str(ca)})
    ca = certs / "ca.pem"
    with pytest.raises(BusError, match=f"No router answers at {endpoint}"):
        ZenohBus(endpoint, "test", identity=expired)
    time.sleep(0.2)
    said = capfd.readouterr().out
    for words in ("certificate expired", "invalid peer certificate: BadSignature", "peer sent no certificates"):
        assert words in said


def test_refusal_is_empty_for_the_coordinator_and_where_all_may_ask() -> None:
    assert refusal("coordinator", ("operator",), CANCEL) == ""
    assert refusal("monitor", (), RunSpecRequest()) == ""


def test_access_control_names_every_role_and_refuses_what_it_does_not_name() -> None:
    access = access_control(("renderer",), ("rec0",))
    assert access["default_permission"] == "deny"
    subjects = {name for subject in access["subjects"] for name in subject["cert_common_names"]}
    assert subjects == {"coordinator", "monitor", "operator", "renderer", "all", "trainer", "recorder.rec0"}
    rules = [rule["id"] for rule in access["rules"]]
    assert len(rules) == len(set(rules))
    assert all(rule in rules for policy in access["policies"] for rule in policy["rules"])


OPEN = {"ctl", "ctl/status", "ctl/fleet", "coord/spec", "coord/*/claim"}
WORK = OPEN | {"coord/*/renew", "coord/*/complete", "blob", "rec/*/append"}
ASKED = {
    "coordinator": None, "monitor": OPEN | {"blob"}, "operator": OPEN | {"blob"}, "renderer": WORK,
    "evaluator": WORK | {"evaluate/*"}, "all": WORK | {"evaluate/*"}, "trainer": OPEN | {"coord/policy"},
    "recorder.rec0": OPEN | {"coord/rec/*", "blob"}, "recorder.west": OPEN | {"coord/rec/*", "blob"},
}  # fmt: skip
"""What each may ask, under its own name; the coordinator may do everything."""
WORKER_HEARS = {"live/wake", "live/progress"}
HEARD = {
    "monitor": {"live/**", "train/**"}, "operator": {"live/**", "train/**"}, "renderer": WORKER_HEARS,
    "evaluator": WORKER_HEARS, "all": WORKER_HEARS, "trainer": {"train/*"}, "recorder.rec0": {"live/progress"},
    "recorder.west": {"live/progress"},
}  # fmt: skip


def test_router_lets_each_name_do_this_and_nothing_else() -> None:
    access = access_control(("renderer", "evaluator"), ("rec0", "west"))
    rules = {rule["id"]: rule for rule in access["rules"]}
    assert access["enabled"]
    assert {name for subject in access["subjects"] for name in subject["cert_common_names"]} == set(ASKED)
    out = rules["out"]
    assert (out["flows"], out["key_exprs"], out["permission"]) == (["egress"], ["readygo/*/**"], "allow")
    for policy in access["policies"]:
        (name,) = policy["subjects"]
        assert policy["rules"][0] == "out"
        own = [rules[number] for number in policy["rules"][1:]]
        assert all((rule["flows"], rule["permission"]) == (["ingress"], "allow") for rule in own)
        allowed: dict[str, set[str]] = {}
        for rule in own:
            for message in rule["messages"]:
                allowed.setdefault(message, set()).update(key.removeprefix("readygo/*/") for key in rule["key_exprs"])
        if name == "coordinator":
            assert allowed == {message: {"**"} for message in out["messages"]}
            continue
        role, _, who = name.partition(".")
        assert allowed.pop("query") == {f"by/{name}/{topic}" for topic in ASKED[name]}
        assert allowed.pop("declare_subscriber") == HEARD[name]
        if role in ("monitor", "operator"):
            assert allowed == {"declare_liveliness_subscriber": {"alive/**"}, "liveliness_query": {"alive/**"}}
            continue
        place = f"{role}/{who or '*'}"
        want = {"liveliness_token": {f"alive/{place}/**"}, "liveliness_query": {f"alive/{place}/**"}}
        want["put"] = {f"live/{place}/*"}
        if role == "recorder":
            want["put"].add("train/episodes")
            want |= {message: {f"by/*/rec/{who}/append"} for message in ("declare_queryable", "reply")}
        assert allowed == want


@pytest.mark.parametrize(
    ("asker", "roles", "request_", "refused"),
    [
        ("coordinator", ("operator",), CANCEL, False),
        ("operator", ("operator", "all"), CANCEL, False),
        ("monitor", ("operator", "all"), CANCEL, True),
        ("recorder.rec0", ("recorder",), DONE, False),
        ("recorder.rec1", ("recorder",), DONE, True),
        ("recorder.rec1", ("recorder",), CANCEL, False),
        ("renderer", (), RunSpecRequest(role="renderer"), False),
        ("renderer", (), RunSpecRequest(role="animator"), True),
        ("recorder.rec0", (), RunSpecRequest(role="recorder"), False),
        ("recorder.rec0", (), RunSpecRequest(role="recorder.rec1"), False),
        ("renderer", (), RunSpecRequest(), False),
        ("renderer", (), DONE, False),
    ],
)
def test_handler_refuses_other_roles_other_recorders_and_joining_as_another(asker, roles, request_, refused) -> None:
    assert bool(refusal(asker, roles, request_)) == refused
