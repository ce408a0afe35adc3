import dataclasses
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.avatars.importers.gltf_file import GltfFile
from readygo.common.avatars.importers.gltf_human import gltf_human
from readygo.common.avatars.importers.gltf_paint import (
    Material,
    bilinear,
    linear_from_srgb,
    paint_part,
    read_materials,
    srgb_from_linear,
)
from readygo.common.avatars.importers.gltf_scene import GltfPart, read_figure
from readygo.common.errors import AvatarError
from tests.common.avatars.importers.humans import write_glb

TRIANGLE = GltfPart(
    positions=np.zeros((3, 3)),
    normals=None,
    uv=np.array([[0.25, 0.5], [0.75, 0.5], [0.25, 0.5]]),
    colours=None,
    bone_index=np.zeros((3, 1), np.int64),
    bone_weight=np.ones((3, 1)),
    triangles=np.array([[0, 1, 2]]),
    material=0,
)
GLASS = Material(
    factor=np.array([1.0, 0.5, 0.0, 0.4]), texture=None, uv_matrix=np.eye(3)[:2], alpha_mode="BLEND", alpha_cutoff=0.5
)
CORNERS = np.eye(3)


def painted(material: Material, part: GltfPart = TRIANGLE) -> np.ndarray:
    return paint_part(part, material, np.zeros(3, np.int64), CORNERS)


@pytest.mark.parametrize(
    ("mode", "cutoff", "alpha"), [("OPAQUE", 0.5, 1.0), ("MASK", 0.5, 0.0), ("MASK", 0.3, 1.0), ("BLEND", 0.5, 0.4)]
)
def test_alpha_is_what_the_mode_says(mode: str, cutoff: float, alpha: float) -> None:
    colours = painted(dataclasses.replace(GLASS, alpha_mode=mode, alpha_cutoff=cutoff))
    np.testing.assert_allclose(colours[:, 3], alpha)
    np.testing.assert_allclose(colours[:, :3], np.tile(srgb_from_linear(np.array([1.0, 0.5, 0.0])), (3, 1)))


def test_vertex_colours_multiply_the_factor_in_linear_light() -> None:
    part = dataclasses.replace(TRIANGLE, colours=np.array([[1.0, 1, 1, 1], [0.5, 0.5, 0.5, 0.5], [0, 0, 0, 1]]))
    colours = painted(GLASS, part)
    np.testing.assert_allclose(colours[1], [*srgb_from_linear(np.array([0.5, 0.25, 0.0])), 0.2])
    np.testing.assert_allclose(colours[2], [0, 0, 0, 0.4])


def test_texture_is_looked_up_at_the_texture_coordinates() -> None:
    texture = np.array([[[200, 0, 0, 255], [0, 0, 100, 255]]], np.uint8)
    plain = dataclasses.replace(GLASS, factor=np.ones(4), texture=texture)
    np.testing.assert_allclose(255 * painted(plain)[:2, :3], [[200, 0, 0], [0, 0, 100]], atol=1e-9)
    moved = dataclasses.replace(plain, uv_matrix=np.array([[1.0, 0.0, 0.5], [0.0, 1.0, 0.0]]))
    np.testing.assert_allclose(255 * painted(moved)[:2, :3], [[0, 0, 100], [200, 0, 0]], atol=1e-9)


def test_texels_blend_between_their_centres_and_repeat() -> None:
    texture = np.zeros((1, 4, 4), np.uint8)
    texture[0, :, 0] = 0, 100, 200, 255
    u = np.array([0.125, 0.25, 0.375, 0.0, 1.375])
    red = 255 * bilinear(texture, np.stack([u, np.full(5, 0.5)], axis=1))[:, 0]
    np.testing.assert_allclose(red, [0, 50, 100, 127.5, 100])


def test_srgb_and_linear_light_are_inverse_and_as_the_standard_says() -> None:
    values = np.linspace(0.0, 1.0, 101)
    np.testing.assert_allclose(srgb_from_linear(linear_from_srgb(values)), values, atol=1e-6)
    np.testing.assert_allclose(linear_from_srgb(np.array([0.02, 0.5])), [0.02 / 12.92, 0.21404114])


def _materials(path: Path, **material: Any) -> tuple[dict[int | None, Material], tuple[str, ...]]:
    def edit(document: dict[str, Any]) -> None:
        document["materials"] = [material]

    file = GltfFile(write_glb(path, edit=edit))
    return read_materials(file, read_figure(file).parts)


def test_texture_transform_turns_scales_and_shifts(tmp_path: Path) -> None:
    transform = {"offset": [0.1, 0.2], "rotation": np.pi / 2, "scale": [2.0, 3.0]}
    texture = {"index": 0, "extensions": {"KHR_texture_transform": transform}}
    materials, notes = _materials(tmp_path / "a.glb", pbrMetallicRoughness={"baseColorTexture": texture})
    np.testing.assert_allclose(materials[0].uv_matrix, [[0, 3, 0.1], [-2, 0, 0.2]], atol=1e-12)
    assert notes == ()


def _second_uv(reference: dict[str, Any], *, has_set: bool = True) -> Any:
    """An edit that gives the human a second UV map, whose coordinates are zeros, and a texture."""

    def edit(document: dict[str, Any]) -> None:
        document["materials"] = [{"name": "Skin", "pbrMetallicRoughness": {"baseColorTexture": reference}}]
        count = document["accessors"][2]["count"]
        document["accessors"].append({"componentType": 5126, "count": count, "type": "VEC2"})
        if has_set:
            document["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_1"] = len(document["accessors"]) - 1

    return edit


@pytest.mark.parametrize(
    "reference",
    [
        {"index": 0, "texCoord": 1},
        {"index": 0, "texCoord": 7, "extensions": {"KHR_texture_transform": {"texCoord": 1}}},
    ],
)
def test_texture_lies_at_the_set_of_coordinates_that_it_names(tmp_path: Path, reference: dict[str, Any]) -> None:
    figure = read_figure(GltfFile(write_glb(tmp_path / "a.glb", edit=_second_uv(reference))))
    assert (figure.parts[0].uv == 0.0).all()
    first = read_figure(GltfFile(write_glb(tmp_path / "b.glb", edit=_second_uv({"index": 0})))).parts[0].uv
    assert np.unique(first, axis=0).tolist() == [[0.5, 0.25], [0.5, 0.75]]


def test_texture_whose_set_of_coordinates_is_missing_is_one_error(tmp_path: Path) -> None:
    path = write_glb(tmp_path / "a.glb", edit=_second_uv({"index": 0, "texCoord": 1}, has_set=False))
    words = (
        r"^.*a\.glb: the texture of material 'Skin' lies at TEXCOORD_1, which a mesh with it lacks; export the figure"
    )
    with pytest.raises(AvatarError, match=words):
        gltf_human(path, count=100)


def test_texture_that_cannot_be_read_is_noted_and_the_factor_stands_in(tmp_path: Path) -> None:
    rough = {"baseColorTexture": {"index": 9}, "baseColorFactor": [0.1, 0.2, 0.3, 1.0]}
    materials, notes = _materials(tmp_path / "a.glb", name="Skin", pbrMetallicRoughness=rough)
    assert materials[0].texture is None
    assert materials[0].factor.tolist() == [0.1, 0.2, 0.3, 1.0]
    assert "'Skin' cannot be read" in notes[0]


def test_colour_of_another_size_is_refused(tmp_path: Path) -> None:
    def edit(document: dict[str, Any]) -> None:
        document["materials"][0].setdefault("pbrMetallicRoughness", {})["baseColorFactor"] = [1.0]

    with pytest.raises(AvatarError, match="a colour of"):
        gltf_human(write_glb(tmp_path / "a.glb", texture=False, edit=edit), count=100)
