"""Pages of the site that `docs/hooks.py` makes."""

import importlib.util
from types import ModuleType

import pytest

from readygo.common.config import section_to_mapping
from readygo.runs.config import RunConfig
from tests.test_readme import ROOT


@pytest.fixture(scope="module")
def hooks() -> ModuleType:
    spec = importlib.util.spec_from_file_location("site_hooks", ROOT / "docs" / "hooks.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_every_service_is_on_the_site(hooks: ModuleType) -> None:
    services = {path.parent.name for path in (ROOT / "services").glob("*/README.md")}
    assert services <= set(hooks.INTERNALS.values())
    nav = (ROOT / "mkdocs.yml").read_text()
    assert [name for name in hooks.INTERNALS.values() if f"internals/{name}.md" not in nav] == []


def test_links_lead_to_pages_and_others_become_text(hooks: ModuleType) -> None:
    text = "[a](../../docs/data.md#camera) [b](../driver/README.md) [c](config.py) [d](https://x.org) "
    text += "![e](../../docs/plan.png)"
    page = hooks.with_site_links(text, "services/planner/README.md", "internals/planner.md")
    assert page == "[a](../data.md#camera) [b](driver.md) c [d](https://x.org) ![e](../plan.png)"


def test_pages_of_docs_lead_to_internals(hooks: ModuleType) -> None:
    page = hooks.with_site_links(
        "[a](../../services/planner/README.md)", "docs/results/planner.md", "results/planner.md"
    )
    assert page == "[a](../internals/planner.md)"


def test_configuration_page_has_every_section_and_key(hooks: ModuleType) -> None:
    page = hooks.configuration_page()
    for section, keys in section_to_mapping(RunConfig()).items():
        assert f"## [{section}]" in page
        for key, value in keys.items():
            assert f"| `{key}` |" in page or isinstance(value, dict)
