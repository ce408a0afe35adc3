"""Pages of the site that are made when it is built: messages, configuration, and documents outside of docs/."""

import ast
import dataclasses
import inspect
import os
import re
import sys
import textwrap
import typing
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
INTERNALS = {
    "ARCHITECTURE.md": "architecture",
    "CONTRIBUTING.md": "tour",
    "benchmarks/README.md": "benchmarks",
    "deploy/README.md": "deploy",
    "examples/README.md": "examples",
    **{str(path.relative_to(ROOT)): path.parent.name for path in sorted((ROOT / "services").glob("*/README.md"))},
}
"""Documents beside docs/, and the names of their pages below internals/."""
LINK = re.compile(r"(?<!!)\[([^\]]*)\]\(([^)#:\s]+)(#[^)]*)?\)")
IMAGE = re.compile(r"!\[([^\]]*)\]\(([^):\s]+)\)")


def on_files(files: Any, config: Any) -> Any:
    """Add the pages, and point the links of docs/ at them."""
    from mkdocs.structure.files import File

    sys.path.insert(0, str(ROOT))
    from readygo.apps.error_reference import errors_page

    files.append(File.generated(config, "errors.md", content=errors_page(ROOT)))
    files.append(File.generated(config, "configuration.md", content=configuration_page()))
    for source, name in INTERNALS.items():
        page = f"internals/{name}.md"
        files.append(File.generated(config, page, content=with_site_links((ROOT / source).read_text(), source, page)))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """A page of docs/ with links to documents outside of it led to their pages."""
    source = page.file.src_uri
    return markdown if source.startswith("internals/") else with_site_links(markdown, f"docs/{source}", source)


def with_site_links(text: str, source: str, page: str) -> str:
    """A document whose links work on the site; links to files that are not on the site become plain text.

    Args:
        text: The document.
        source: Its path in the repository.
        page: Its path on the site.
    """

    def target_of(link: str) -> str | None:
        path = os.path.normpath(PurePosixPath(source).parent / link)
        if path in INTERNALS:
            target = f"internals/{INTERNALS[path]}.md"
        elif path.startswith("docs/"):
            target = path.removeprefix("docs/")
        else:
            return None
        return os.path.relpath(target, PurePosixPath(page).parent)

    def replaced(match: re.Match[str]) -> str:
        words, link, anchor = match.group(1), match.group(2), match.group(3) or ""
        target = target_of(link)
        return words if target is None else f"[{words}]({target}{anchor})"

    text = LINK.sub(replaced, text)
    return IMAGE.sub(lambda match: f"![{match.group(1)}]({target_of(match.group(2)) or match.group(2)})", text)


def configuration_page() -> str:
    """Every key of a run's configuration file, by section, with its default and its meaning."""
    from readygo.runs.config import RunConfig

    parts = [
        "# Configuration\n\n`--config FILE` takes a TOML file with these sections; a key that is left out has its "
        "default. The resolved settings are recorded with the data. `robot.toml` has the keys of `[robot]` without the "
        "section.\n"
    ]
    for field in dataclasses.fields(RunConfig):
        parts.extend(_section(field.name, typing.get_type_hints(RunConfig)[field.name]))
    return "\n".join(parts)


def _section(name: str, cls: type) -> list[str]:
    rows, inner, hints = [], [], typing.get_type_hints(cls)
    meanings = _meanings(cls)
    for field in dataclasses.fields(cls):
        if dataclasses.is_dataclass(hint := hints[field.name]):
            inner.extend(_section(f"{name}.{field.name}", hint))
            continue
        value = field.default
        if value is dataclasses.MISSING:
            value = "" if field.default_factory is dataclasses.MISSING else field.default_factory()
        default = "" if value is None or value == "" else f"`{getattr(value, 'value', value)}`"
        rows.append(f"| `{field.name}` | {default} | {meanings.get(field.name, '')} |".replace("\n", " "))
    words = " ".join((inspect.getdoc(cls) or "").split("\n\n")[0].split())
    table = ["| key | default | meaning |", "|---|---|---|", *rows, ""] if rows else []
    return [f"## [{name}]\n\n{words}\n", *table, *inner]


def _meanings(cls: type) -> dict[str, str]:
    """The docstrings below the fields of a dataclass and of the classes that it inherits from."""
    found: dict[str, str] = {}
    for owner in reversed([one for one in cls.__mro__ if dataclasses.is_dataclass(one)]):
        body = ast.parse(textwrap.dedent(inspect.getsource(owner))).body[0].body  # type: ignore[attr-defined]
        for node, following in pairwise(body):
            says = isinstance(following, ast.Expr) and isinstance(following.value, ast.Constant)
            if isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name) and says:
                found[node.target.id] = " ".join(str(following.value.value).split()).replace("|", "\\|")
    return found
