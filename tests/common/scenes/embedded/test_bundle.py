import shutil
from pathlib import Path

import pytest

from readygo.common.errors import SceneError
from readygo.common.gaussians import GaussianCloud
from readygo.common.scenes import Scene, load_scene
from readygo.common.scenes.embedded import bundle, ensure_embedded_scene


def test_bundle_is_made_once_and_then_loaded(made: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bundle, "embedded_scene_cloud", lambda seed: pytest.fail("made again"))
    again = ensure_embedded_scene(made.path)
    assert again.content_hash == made.content_hash
    assert again.name == "embedded"
    assert [path.name for path in made.path.parent.iterdir()] == ["embedded"]


def test_bundle_of_another_recipe_is_replaced(
    made: Scene, cloud: GaussianCloud, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(made.path, tmp_path / "scene")
    monkeypatch.setattr(bundle, "recipe_hash", lambda name: "another")
    monkeypatch.setattr(bundle, "embedded_scene_cloud", lambda seed: cloud)
    scene = ensure_embedded_scene(tmp_path / "scene")
    assert scene.metadata["source"]["sha256"] == "another"
    assert load_scene(tmp_path / "scene").content_hash == made.content_hash
    assert [path.name for path in tmp_path.iterdir()] == ["scene"]


def test_foreign_folder_is_refused_and_kept(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(SceneError, match="something else"):
        ensure_embedded_scene(tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_another_scene_is_refused_by_its_name(made: Scene, tmp_path: Path) -> None:
    shutil.copytree(made.path, tmp_path / "scene")
    manifest = tmp_path / "scene" / "scene.toml"
    manifest.write_text(manifest.read_text().replace("readygo embedded scene", "flat.ply"))
    with pytest.raises(SceneError, match="another scene \\('embedded'\\)"):
        ensure_embedded_scene(tmp_path / "scene")


def test_recipe_is_the_code_of_scene_and_maps(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = bundle.recipe_hash()
    folder = Path(bundle.__file__).parent
    shutil.copytree(folder, tmp_path / "embedded")
    monkeypatch.setattr(bundle, "__file__", str(tmp_path / "embedded" / "bundle.py"))
    assert bundle.recipe_hash() == before
    (tmp_path / "embedded" / "plan.py").write_text("")
    assert bundle.recipe_hash() != before


def test_flats_of_other_seeds_have_other_names_and_recipes() -> None:
    names = [bundle.scene_name(0), bundle.scene_name(3), bundle.scene_name(3, own_plan=True)]
    assert names == ["embedded", "embedded-3", "embedded-plan-3"]
    assert len({bundle.recipe_hash(name) for name in names}) == 3
