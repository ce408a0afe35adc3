"""Colours of glTF materials: factors, vertex colours and base-colour textures."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array, UInt8Array
from readygo.common.avatars.importers.gltf_file import (
    GltfFile,
    Json,
    base_colour_texture,
    texture_transform,
    uv_set,
)
from readygo.common.avatars.importers.gltf_scene import GltfPart
from readygo.common.errors import AvatarError


@dataclass(frozen=True, kw_only=True, eq=False)
class Material:
    """What of a material has to do with colour."""

    factor: Float64Array
    """Linear RGBA, shape (4,)."""
    texture: UInt8Array | None
    """sRGB and alpha, shape (H, W, 4)."""
    uv_matrix: Float64Array
    """Maps (u, v, 1) to texture coordinates, shape (2, 3)."""
    alpha_mode: str
    alpha_cutoff: float


def read_materials(file: GltfFile, parts: Sequence[GltfPart]) -> tuple[dict[int | None, Material], tuple[str, ...]]:
    """Materials of all parts by their number, and notes on textures that cannot be read.

    Raises:
        AvatarError: If a texture lies at further texture coordinates that a part lacks.
    """
    materials: dict[int | None, Material] = {}
    notes = []
    for number in sorted({part.material for part in parts}, key=lambda value: -1 if value is None else value):
        entry: Json = {} if number is None else file.items("materials")[number]
        materials[number], readable = _material(file, entry)
        at = uv_set(base_colour_texture(entry) or {})
        textured = materials[number].texture is not None
        if at != 0 and textured and any(part.uv is None for part in parts if part.material == number):
            raise AvatarError(
                f"{file.path}: the texture of material {entry.get('name', number)!r} lies at TEXCOORD_{at}, which a "
                "mesh with it lacks; export the figure with all of its UV maps."
            )
        if not readable:
            notes.append(f"The texture of material {entry.get('name', number)!r} cannot be read; its colour stands in.")
    if all(material.texture is None for material in materials.values()):
        notes.append("The file has no texture: colours are those of its materials.")
    return materials, tuple(notes)


def paint_part(part: GltfPart, material: Material, triangle: Int64Array, bary: Float64Array) -> Float64Array:
    """Colours of points on a part, sRGB and alpha in 0..1.

    Args:
        part: The triangles.
        material: Theirs.
        triangle: Triangle of each point, shape (M,).
        bary: Barycentric coordinates, shape (M, 3).

    Returns:
        Shape (M, 4); alpha is 0 or 1 unless the material blends.
    """
    corners = part.triangles[triangle]
    linear = np.tile(material.factor, (len(triangle), 1))
    if part.colours is not None:
        linear *= np.einsum("mk,mkc->mc", bary, part.colours[corners])
    if material.texture is not None and part.uv is not None:
        uv = np.einsum("mk,mkc->mc", bary, part.uv[corners])
        texels = bilinear(material.texture, uv @ material.uv_matrix[:, :2].T + material.uv_matrix[:, 2])
        linear[:, :3] *= linear_from_srgb(texels[:, :3])
        linear[:, 3] *= texels[:, 3]
    if material.alpha_mode == "OPAQUE":
        linear[:, 3] = 1.0
    elif material.alpha_mode == "MASK":
        linear[:, 3] = linear[:, 3] >= material.alpha_cutoff
    linear = np.clip(linear, 0.0, 1.0)
    return np.concatenate([srgb_from_linear(linear[:, :3]), linear[:, 3:]], axis=1)


def bilinear(texture: UInt8Array, uv: Float64Array) -> Float64Array:
    """Texels in 0..1 at texture coordinates (0, 0 = outer corner of the first texel), repeated beyond 0..1."""
    height, width = texture.shape[:2]
    x, y = uv[:, 0] * width - 0.5, uv[:, 1] * height - 0.5
    left, top = np.floor(x), np.floor(y)
    fx, fy = (x - left)[:, None], (y - top)[:, None]
    x0, y0 = left.astype(np.int64) % width, top.astype(np.int64) % height
    x1, y1 = (x0 + 1) % width, (y0 + 1) % height
    upper = texture[y0, x0] * (1 - fx) + texture[y0, x1] * fx
    lower = texture[y1, x0] * (1 - fx) + texture[y1, x1] * fx
    blended: Float64Array = (upper * (1 - fy) + lower * fy) / 255.0
    return blended


def linear_from_srgb(colour: Float64Array) -> Float64Array:
    """Linear light of sRGB values in 0..1 (IEC 61966-2-1)."""
    low: Float64Array = colour / 12.92
    return np.where(colour <= 0.04045, low, ((colour + 0.055) / 1.055) ** 2.4)


def srgb_from_linear(colour: Float64Array) -> Float64Array:
    """SRGB values of linear light in 0..1 (IEC 61966-2-1)."""
    low: Float64Array = colour * 12.92
    return np.where(colour <= 0.0031308, low, 1.055 * colour ** (1 / 2.4) - 0.055)


def _material(file: GltfFile, entry: Json) -> tuple[Material, bool]:
    """The material, and whether its texture, if it has one, could be read."""
    rough = entry.get("pbrMetallicRoughness", {})
    glossy = entry.get("extensions", {}).get("KHR_materials_pbrSpecularGlossiness", {})
    factor = rough.get("baseColorFactor", glossy.get("diffuseFactor", (1.0, 1.0, 1.0, 1.0)))
    if np.shape(factor) != (4,):
        raise ValueError(f"a colour of {np.shape(factor)} numbers")
    reference = base_colour_texture(entry)
    texture = None if reference is None else _texture(file, reference)
    material = Material(
        factor=np.array(factor, dtype=np.float64),
        texture=texture,
        uv_matrix=_uv_matrix(reference or {}),
        alpha_mode=str(entry.get("alphaMode", "OPAQUE")),
        alpha_cutoff=float(entry.get("alphaCutoff", 0.5)),
    )
    return material, reference is None or texture is not None


def _texture(file: GltfFile, reference: Json) -> UInt8Array | None:
    try:
        entry: dict[str, Any] = dict(file.items("textures")[int(reference["index"])])
    except (KeyError, IndexError):
        return None
    source = entry.get("source", entry.get("extensions", {}).get("EXT_texture_webp", {}).get("source"))
    return None if source is None else file.image(int(source))


def _uv_matrix(reference: Json) -> Float64Array:
    """The extension KHR_texture_transform as a matrix."""
    transform = texture_transform(reference)
    (sx, sy), (ox, oy) = transform.get("scale", (1.0, 1.0)), transform.get("offset", (0.0, 0.0))
    angle = float(transform.get("rotation", 0.0))
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c * sx, s * sy, ox], [-s * sx, c * sy, oy]])
