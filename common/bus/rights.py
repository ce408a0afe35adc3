"""Rights by the names of certificates: what the router lets through, and what a handler does not answer.

A participant asks under its own name, below `readygo/{run}/by/{name}/`; the router refuses requests under another name.
So a handler knows who asks. The router refuses in silence, a handler with a reason that it logs: hence the router lets
everybody with a certificate ask what an operator's or a worker's first mistake would be (`_OPEN`), and nothing else
that is not of their role.
"""

from collections.abc import Iterable, Mapping
from typing import Any

from readygo.common.bus.identity import ALL, COORDINATOR, MONITOR, OPERATOR, RECORDER, TRAINER, role_of
from readygo.common.messages.stages import EVALUATE

_OPEN = ("ctl", "ctl/status", "ctl/fleet", "coord/spec", "coord/*/claim")
_WORKERS_ASK = ("coord/*/renew", "coord/*/complete", "blob", "rec/*/append")
_EVALUATORS_ASK = ("evaluate/*",)
_RECORDERS_ASK = ("coord/rec/*", "blob")
_EVERYTHING = (
    "put",
    "delete",
    "declare_subscriber",
    "query",
    "declare_queryable",
    "reply",
    "liveliness_token",
    "declare_liveliness_subscriber",
    "liveliness_query",
)
_LOOK = ("declare_subscriber",)
_SEE_WHO_IS_THERE = ("declare_liveliness_subscriber", "liveliness_query")


def access_control(workers: Iterable[str], recorders: Iterable[str]) -> dict[str, Any]:
    """Zenoh's `access_control` of a router: every key that is not named is refused.

    Args:
        workers: Roles of those that claim stages.
        recorders: Names of the run's recorders.

    Source: https://zenoh.io/docs/manual/access-control
    """
    rules: dict[str, list[dict[str, Any]]] = {COORDINATOR: [_rule(_EVERYTHING, "**")]}
    for role in (MONITOR, OPERATOR):
        rules[role] = [_rule(_LOOK, "live/**", "train/**"), _rule(_SEE_WHO_IS_THERE, "alive/**"), _asks(role, "blob")]
    for role in (*workers, ALL):
        asked = (*_WORKERS_ASK, *(_EVALUATORS_ASK if role in (EVALUATE.role, ALL) else ()))
        rules[role] = [_asks(role, *asked), *_takes_part(role, "*", "live/wake", "live/progress")]
    rules[TRAINER] = [_asks(TRAINER, "coord/policy"), *_takes_part(TRAINER, "*", "train/*")]
    for name in recorders:
        common_name = f"{RECORDER}.{name}"
        serves = _rule(("declare_queryable", "reply"), f"by/*/rec/{name}/append")
        says = _rule(("put",), "train/episodes")
        part = _takes_part(RECORDER, name, "live/progress")
        rules[common_name] = [_asks(common_name, *_RECORDERS_ASK), serves, says, *part]
    return _router_config(rules)


def _asks(name: str, *topics: str) -> dict[str, Any]:
    # A reply comes under the key that was asked; a recorder replies to others, hence not here.
    return _rule(("query",), *(f"by/{name}/{topic}" for topic in (*_OPEN, *topics)))


def _takes_part(role: str, name: str, *hears: str) -> list[dict[str, Any]]:
    """Rules for a participant: to be present, to publish its live streams, and to hear some streams."""
    return [
        _rule(("liveliness_token", "liveliness_query"), f"alive/{role}/{name}/**"),
        _rule(("put",), f"live/{role}/{name}/*"),
        _rule(_LOOK, *hears),
    ]


def _rule(messages: Iterable[str], *keys: str) -> dict[str, Any]:
    return {
        "permission": "allow",
        "flows": ["ingress"],
        "messages": list(messages),
        "key_exprs": [f"readygo/*/{key}" for key in keys],
    }


def _router_config(rules: Mapping[str, list[dict[str, Any]]]) -> dict[str, Any]:
    """The configuration of rules by common name; what comes out of the router is what was asked for."""
    out = {**_rule(_EVERYTHING, "**"), "flows": ["egress"], "id": "out"}
    named = {name: [{**rule, "id": f"{name} {n}"} for n, rule in enumerate(own)] for name, own in rules.items()}
    return {
        "enabled": True,
        "default_permission": "deny",
        "rules": [out, *(rule for own in named.values() for rule in own)],
        "subjects": [{"id": name, "cert_common_names": [name]} for name in named],
        "policies": [{"subjects": [name], "rules": ["out", *(r["id"] for r in own)]} for name, own in named.items()],
    }


def refusal(asker: str, roles: Iterable[str], request: object) -> str:
    """Why a request is not answered; empty if it is.

    Args:
        asker: Common name under which it came.
        roles: Roles that may ask; empty for all.
        request: What was asked: a recorder speaks only for itself, and a participant only in its own role.
    """
    role, _, name = asker.partition(".")
    if role == COORDINATOR:
        return ""
    if (allowed := tuple(roles)) and role not in allowed:
        return f"a certificate of {asker!r} does not allow that; it takes one of {', '.join(allowed)}"
    if role == RECORDER and getattr(request, "recorder", name) != name:
        return f"a certificate of {asker!r} does not speak for another recorder"
    claimed = getattr(request, "role", "")
    if claimed and role_of(claimed) != role:
        return f"a certificate of {asker!r} does not allow to join as {claimed}"
    return ""
