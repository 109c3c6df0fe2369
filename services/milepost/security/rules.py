"""A router's access control in Zenoh's form: default deny, one policy for each common name of a certificate."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from milepost.config.train import Train
from milepost_schemas import HEARING_KEY, ROOT, router_key

from .access import CACHE, ROUTERS, Access, accesses

# `**` does not match a chunk that begins with `@`
EVERYTHING = ("**", f"{ROOT}/*/@rpc/**", f"{ROOT}/*/@sim/**", f"{ROOT}/*/@chaos/**", f"**/{CACHE}", router_key("*"))
DECLARATIONS = ("declare_subscriber", "declare_queryable")
MESSAGES = (
    "put",
    "delete",
    *DECLARATIONS,
    "query",
    "reply",
    "liveliness_token",
    "liveliness_query",
    "declare_liveliness_subscriber",
)
Rule = tuple[str, tuple[str, ...], Sequence[str]]


def access_control(train: Train) -> dict[str, Any]:
    """The section `access_control` of a router's configuration. Raises ConfigError."""
    rules, subjects, policies = [], [], []
    for access in accesses(train):
        mine = [_rule(f"{access.name}: {what}", *rule) for what, rule in _rules(access) if rule[2]]
        rules += mine
        subjects.append(_subject(access.name, [access.name]))
        policies.append({"id": access.name, "subjects": [access.name], "rules": [rule["id"] for rule in mine]})
    # a sample was checked where it came in; of two linked routers the other one did that
    linked = [_rule(f"routers: {flow}", flow, MESSAGES, EVERYTHING) for flow in ("ingress", "egress")]
    rules += linked
    subjects.append(_subject("routers", ROUTERS))
    policies.append({"id": "routers", "subjects": ["routers"], "rules": [rule["id"] for rule in linked]})
    return {"enabled": True, "default_permission": "deny", "rules": rules, "subjects": subjects, "policies": policies}


def _rules(access: Access) -> Iterator[tuple[str, Rule]]:
    """What comes from a process (ingress) and what goes to it (egress)."""
    sent, got = _caches(access.remembers), _caches(access.recovers)
    yield "sends", ("ingress", ("put",), (*access.sends, *sent))
    yield "subscribes", ("ingress", ("declare_subscriber",), (*access.receives, *got))
    yield "receives", ("egress", ("put",), (*access.receives, *got))
    yield "shows its token", ("ingress", ("liveliness_token",), (*access.shows, *sent))
    yield "watches tokens", ("ingress", ("liveliness_query", "declare_liveliness_subscriber"), (*access.watches, *got))
    yield "asks whether it hears", ("ingress", ("liveliness_query",), (HEARING_KEY,))
    yield "sees tokens", ("egress", ("liveliness_token",), (*access.watches, *got))
    yield "answers", ("ingress", ("declare_queryable",), (*access.answers, *sent))
    # a cache answers with what was sent, on its key
    yield "replies", ("ingress", ("reply",), (*access.answers, *access.remembers))
    yield "is asked", ("egress", ("query",), access.hears)
    yield "asks", ("ingress", ("query",), (*access.asks, *got))
    yield "is answered", ("egress", ("reply",), (*access.asks, *access.recovers))
    # who else listens and answers: a publisher sends nothing before it knows that somebody listens. No content
    yield "is told of listeners", ("egress", DECLARATIONS, EVERYTHING)


def _caches(keys: Sequence[str]) -> tuple[str, ...]:
    return tuple(f"{key}/{CACHE}" for key in keys)


def _rule(name: str, flow: str, messages: Sequence[str], keys: Sequence[str]) -> dict[str, Any]:
    return {"id": name, "permission": "allow", "flows": [flow], "messages": list(messages), "key_exprs": list(keys)}


def _subject(name: str, common_names: Sequence[str]) -> dict[str, Any]:
    return {"id": name, "cert_common_names": list(common_names), "link_protocols": ["tls"]}
