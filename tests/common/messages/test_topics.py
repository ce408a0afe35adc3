import re
from pathlib import Path

import pytest

from readygo.common.messages import topics
from readygo.common.messages.topics import Live, Stream, Topic, matches

ROOT = Path(__file__).resolve().parents[3]
TOPICS = [
    *(value for value in vars(topics).values() if isinstance(value, (Topic, Stream))),
    *(value.of() for value in vars(topics).values() if isinstance(value, Live)),
    *(make("*") for make in (topics.claim, topics.renew, topics.complete, topics.append, topics.render)),
]


def test_names_of_the_wire_do_not_change_silently() -> None:
    assert sorted(topic.name for topic in TOPICS) == [
        "animate",
        "blob",
        "coord/*/claim",
        "coord/*/complete",
        "coord/*/renew",
        "coord/policy",
        "coord/rec/done",
        "coord/rec/expect",
        "coord/rec/grant",
        "coord/rec/lost",
        "coord/rec/pending",
        "coord/rec/trouble",
        "coord/spec",
        "ctl",
        "ctl/fleet",
        "ctl/status",
        "evaluate/drives",
        "evaluate/keep",
        "evaluate/plan",
        "human-plan",
        *(f"live/*/*/{kind}" for kind in ("commit", "evaluation", "health", "loss")),
        *(f"live/*/*/{kind}" for kind in ("perception", "plan", "preview", "state", "work")),
        "live/progress",
        "live/reconstruct",
        "live/wake",
        "rec/*/append",
        "reconstruct/claim",
        "reconstruct/report",
        "render/*",
        "robot-plan",
        "train/episodes",
    ]
    assert topics.presence("renderer", "r0") == "alive/renderer/r0"


@pytest.mark.parametrize("folder", ["common", "services", "runs", "apps", "benchmarks"])
def test_no_topic_is_written_down_anywhere_else(folder: str) -> None:
    literal = re.compile(r"""["'](coord/|ctl["'/]|rec/|render/|blob["']|reconstruct/|alive/|live/|train/)""")
    found = [
        f"{path.relative_to(ROOT)}: {line.strip()}"
        for path in (ROOT / folder).rglob("*.py")
        for line in path.read_text().splitlines()
        if literal.search(line) and path.name not in ("topics.py", "rights.py")
    ]
    assert found == []


def test_every_topic_stands_in_the_architecture() -> None:
    rows = (ROOT / "ARCHITECTURE.md").read_text().split("| topic |")[1].split("\n## ")[0]
    for topic in TOPICS:
        last_word = topic.name.rsplit("/", 1)[-1]
        assert (topic.name.split("/*")[0] if last_word == "*" else last_word) in rows, topic.name


def test_star_stands_for_one_part() -> None:
    assert matches("live/*/*/state", "live/renderer/r0/state")
    assert matches("live/progress", "live/progress")
    assert not matches("live/*/*/state", "live/renderer/r0/work")
    assert not matches("live/*", "live/renderer/r0")
