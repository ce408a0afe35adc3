import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TOPS = ("common", "services", "apps", "benchmarks")
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())


def test_every_package_of_the_tree_is_in_the_wheel() -> None:
    tree = {
        "readygo." + ".".join(path.parent.relative_to(ROOT).parts)
        for top in TOPS
        for path in (ROOT / top).rglob("__init__.py")
    }
    assert tree | {"readygo"} == set(PROJECT["tool"]["setuptools"]["packages"])


def test_every_package_has_an_init_file() -> None:
    folders = {path.parent for top in TOPS for path in (ROOT / top).rglob("*.py")}
    assert [folder for folder in sorted(folders) if not (folder / "__init__.py").exists()] == []


def test_every_data_file_of_the_packages_is_in_the_wheel() -> None:
    patterns = PROJECT["tool"]["setuptools"]["package-data"]["*"]
    suffixes = {".npz", ".proto", ".json", ".html", ".css"}
    files = [p for top in ("common", "services", "apps") for p in (ROOT / top).rglob("*") if p.suffix in suffixes]
    missing = [str(file) for file in files if not any(file.match(pattern) for pattern in patterns)]
    assert files
    assert missing == []
