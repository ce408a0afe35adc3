"""The skinned figure of a glTF file in its bind pose: bones, triangles, materials."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import AnyArray, Float64Array, Int64Array
from readygo.common.avatars.importers.gltf_file import GltfFile, Json, base_colour_texture, uv_set
from readygo.common.errors import AvatarError
from readygo.common.frames import matrix_from_quat

NODES_MAX = 2**16
"""Nodes of a file, and joints of its skins together; figures have some hundred."""
TRIANGLES_MAX = 500_000
_TRIANGLES = 4


@dataclass(frozen=True, kw_only=True, eq=False)
class Bones:
    """A foreign skeleton; parents stand before their children."""

    names: tuple[str, ...]
    nodes: tuple[int, ...]
    """Numbers of the file's nodes."""
    parents: Int64Array
    """Nearest ancestor that is a bone, -1 for none, shape (B,)."""
    heads: Float64Array
    """Where each bone begins in the bind pose, shape (B, 3)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GltfPart:
    """Triangles of one material; V vertices, F triangles."""

    positions: Float64Array
    """Bind pose, shape (V, 3)."""
    normals: Float64Array | None
    uv: Float64Array | None
    """Texture coordinates of the set that the material's texture lies at, shape (V, 2)."""
    colours: Float64Array | None
    """Linear RGBA in 0..1, shape (V, 4)."""
    bone_index: Int64Array
    """Bones that move each vertex, shape (V, k)."""
    bone_weight: Float64Array
    """Shape (V, k), rows sum to 1."""
    triangles: Int64Array
    material: int | None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tree:
    """How the nodes of a file depend on each other."""

    parents: list[int]
    """Parent of each node, -1: none."""
    order: list[int]
    """All nodes, parents before their children."""
    depths: list[int]
    """Steps from each node to its root."""

    def nearest(self, chosen: Collection[int]) -> list[int]:
        """The nearest ancestor of each node that is among some; -1 if there is none."""
        found = [-1] * len(self.parents)
        for node in self.order:
            parent = self.parents[node]
            found[node] = parent if parent in chosen or parent < 0 else found[parent]
        return found


@dataclass(frozen=True, kw_only=True, eq=False)
class GltfFigure:
    """A skinned figure in its bind pose, in the axes that it was modelled in."""

    bones: Bones
    parts: tuple[GltfPart, ...]
    scale: float
    """Length in the scene, which glTF measures in metres, of a unit of the bind pose."""


def read_figure(file: GltfFile) -> GltfFigure:
    """All skinned meshes of a file, in the bind pose of the first skin.

    Inverse bind matrices, not the nodes' present places, say where bones and skin fit together: files often rest in
    the first frame of an animation.

    Raises:
        AvatarError: If nothing in it is skinned, or skin and bones do not fit.
    """
    nodes = file.items("nodes")
    if len(nodes) > NODES_MAX:
        raise AvatarError(f"{file.path} has {len(nodes)} nodes; at most {NODES_MAX} are read.")
    skinned = [node for node in nodes if "mesh" in node and "skin" in node]
    if not skinned:
        raise AvatarError(f"{file.path} has no skin: give a figure whose mesh is bound to bones.")
    tree = _tree(nodes)
    world = _world_matrices(nodes, tree)
    numbers = sorted({int(node["skin"]) for node in skinned})
    if sum(len(file.items("skins")[number]["joints"]) for number in numbers) > NODES_MAX:
        raise AvatarError(f"{file.path} has skins of more than {NODES_MAX} joints.")
    skins = [_skin(file, number) for number in numbers]
    binds, spaces = _common_space(skins, world)
    nearest = tree.nearest(binds)
    bones = _bones(nodes, tree, binds, nearest)
    place = {node: k for k, node in enumerate(bones.nodes)}
    parts = []
    for node in skinned:
        k = numbers.index(int(node["skin"]))
        joints = np.array([place[joint] for joint in skins[k][0]])
        parts += _parts(file, int(node["mesh"]), joints, spaces[k])
    parts += _rigid_parts(file, nearest, world, binds, place)
    if sum(len(part.triangles) for part in parts) > TRIANGLES_MAX:
        raise AvatarError(f"{file.path} has more than {TRIANGLES_MAX:,} triangles: give a simpler mesh.")
    joint, inverse = skins[0][0][0], skins[0][1][0]
    scale = float(np.cbrt(abs(np.linalg.det((world[joint] @ inverse)[:3, :3]))))
    lengths = (np.array([scale]), bones.heads, *(part.positions for part in parts))
    if not (scale > 0.0 and all(np.isfinite(values).all() for values in lengths)):
        raise AvatarError(f"{file.path} places bones or skin at no finite place; the file is damaged.")
    return GltfFigure(bones=bones, parts=tuple(parts), scale=scale)


def _skin(file: GltfFile, number: int) -> tuple[list[int], Float64Array]:
    """Nodes of a skin's joints and their inverse bind matrices, shape (J, 4, 4)."""
    skin = file.items("skins")[number]
    joints = [int(joint) for joint in skin["joints"]]
    if not all(0 <= joint < len(file.items("nodes")) for joint in joints):
        raise AvatarError(f"{file.path}: skin {number} names joints that are no nodes; the file is damaged.")
    if "inverseBindMatrices" not in skin:
        raise AvatarError(f"{file.path}: skin {number} has no inverse bind matrices; export it again with them.")
    values = file.accessor(int(skin["inverseBindMatrices"])).astype(np.float64)
    inverse = values.reshape(-1, 4, 4).transpose(0, 2, 1)
    if len(inverse) < len(joints) or not np.isfinite(inverse).all():
        raise AvatarError(
            f"{file.path}: the inverse bind matrices of skin {number} do not fit its {len(joints)} joints."
        )
    if (np.abs(np.linalg.det(inverse[: len(joints), :3, :3])) < 1e-18).any():
        raise AvatarError(f"{file.path}: skin {number} has inverse bind matrices that cannot be inverted.")
    return joints, inverse[: len(joints)]


def _common_space(
    skins: Sequence[tuple[list[int], Float64Array]], world: Sequence[Float64Array]
) -> tuple[dict[int, Float64Array], list[Float64Array]]:
    """Bind matrices of all joints by node, and what maps each skin's bind space to that of the first skin."""
    binds: dict[int, Float64Array] = {}
    spaces: list[Float64Array] = []
    joint_0, inverse_0 = skins[0][0][0], skins[0][1][0]
    for joints, inverse in skins:
        space = np.eye(4)
        if spaces:
            shared = next((k for k, joint in enumerate(joints) if joint in binds), None)
            if shared is not None:
                space = binds[joints[shared]] @ inverse[shared]
            else:
                space = np.linalg.inv(world[joint_0] @ inverse_0) @ world[joints[0]] @ inverse[0]
        spaces.append(space)
        for joint, matrix in zip(joints, inverse, strict=True):
            binds.setdefault(joint, space @ np.linalg.inv(matrix))
    return binds, spaces


def _bones(nodes: Sequence[Json], tree: _Tree, binds: dict[int, Float64Array], nearest: Sequence[int]) -> Bones:
    order = sorted(binds, key=lambda node: (tree.depths[node], node))
    place = {node: k for k, node in enumerate(order)}
    return Bones(
        names=tuple(str(nodes[node].get("name", f"node {node}")) for node in order),
        nodes=tuple(order),
        parents=np.array([place.get(nearest[node], -1) for node in order], dtype=np.int64),
        heads=np.array([binds[node][:3, 3] for node in order]),
    )


def _parts(file: GltfFile, mesh: int, joints: Int64Array, space: Float64Array) -> list[GltfPart]:
    parts = []
    for primitive in file.primitives(mesh):
        attributes = primitive["attributes"]
        if int(primitive.get("mode", _TRIANGLES)) != _TRIANGLES or "POSITION" not in attributes:
            continue
        if "JOINTS_0" not in attributes or "WEIGHTS_0" not in attributes:
            raise AvatarError(f"{file.path}: mesh {mesh} has a skin, but vertices without joints and weights.")
        sets = [k for k in range(4) if f"JOINTS_{k}" in attributes and f"WEIGHTS_{k}" in attributes]
        index = np.concatenate([file.accessor(attributes[f"JOINTS_{k}"]) for k in sets], axis=1).astype(np.int64)
        weight = np.concatenate([file.accessor(attributes[f"WEIGHTS_{k}"]) for k in sets], axis=1).astype(np.float64)
        if not np.isfinite(weight).all():
            raise AvatarError(f"{file.path}: skinning weights of mesh {mesh} are not finite.")
        total = weight.sum(axis=1, keepdims=True)
        used = weight > 0
        if (total <= 0).any() or index[used].max(initial=0) >= len(joints):
            raise AvatarError(f"{file.path}: skinning weights of mesh {mesh} are zero or name joints it has not.")
        index = joints[np.where(used, index, 0)]
        parts.append(_part(file, primitive, space, index, weight / total))
    return parts


def _rigid_parts(
    file: GltfFile,
    nearest: Sequence[int],
    world: Sequence[Float64Array],
    binds: dict[int, Float64Array],
    place: dict[int, int],
) -> list[GltfPart]:
    """Meshes that hang at a bone without being skinned, such as glasses."""
    parts = []
    for number, node in enumerate(file.items("nodes")):
        if "mesh" not in node or "skin" in node:
            continue
        if (bone := nearest[number]) < 0:
            continue
        space = binds[bone] @ np.linalg.inv(world[bone]) @ world[number]
        for primitive in file.primitives(int(node["mesh"])):
            if int(primitive.get("mode", _TRIANGLES)) != _TRIANGLES or "POSITION" not in primitive["attributes"]:
                continue
            # Checked first: the count is what the file claims.
            count = len(file.accessor(primitive["attributes"]["POSITION"]))
            index = np.full((count, 1), place[bone], dtype=np.int64)
            parts.append(_part(file, primitive, space, index, np.ones((count, 1))))
    return parts


def _part(file: GltfFile, primitive: Json, space: Float64Array, index: Int64Array, weight: Float64Array) -> GltfPart:
    attributes = primitive["attributes"]

    def optional(name: str, *sizes: int) -> AnyArray | None:
        values = file.accessor(attributes[name]).astype(np.float64) if name in attributes else None
        return values if values is None or (len(values) == count and values.shape[1] in sizes) else None

    positions = file.accessor(attributes["POSITION"]).astype(np.float64)
    count = len(positions)
    if positions.shape[1] != 3 or not np.isfinite(positions).all() or len(index) != count:
        raise AvatarError(f"{file.path}: vertices that are not finite, or not one weight each; the file is damaged.")
    corners = file.accessor(primitive["indices"])[:, 0] if "indices" in primitive else np.arange(count)
    triangles = corners[: len(corners) // 3 * 3].reshape(-1, 3).astype(np.int64)
    if triangles.max(initial=0) >= count:
        raise AvatarError(f"{file.path}: triangles name vertices beyond the {count} of their mesh.")
    normals = optional("NORMAL", 3)
    if normals is not None:
        normals = normals @ np.linalg.inv(space[:3, :3])
    colours = optional("COLOR_0", 3, 4)
    if colours is not None and colours.shape[1] == 3:
        colours = np.concatenate([colours, np.ones((count, 1))], axis=1)
    material: int | None = primitive.get("material")
    reference = None if material is None else base_colour_texture(file.items("materials")[material])
    return GltfPart(
        positions=positions @ space[:3, :3].T + space[:3, 3],
        normals=normals,
        uv=optional(f"TEXCOORD_{uv_set(reference or {})}", 2),
        colours=colours,
        bone_index=index,
        bone_weight=weight,
        triangles=triangles,
        material=material,
    )


def _tree(nodes: Sequence[Json]) -> _Tree:
    parents = [-1] * len(nodes)
    for number, node in enumerate(nodes):
        for child in node.get("children", []):
            if not 0 <= child < len(nodes):
                raise IndexError(f"node {number} has a child {child}, which is not there")
            parents[child] = number
    children: list[list[int]] = [[] for _ in nodes]
    for number, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(number)
    order = [number for number, parent in enumerate(parents) if parent < 0]
    depths = [0] * len(nodes)
    for number in order:
        for child in children[number]:
            depths[child] = depths[number] + 1
            order.append(child)
    if len(order) < len(nodes):
        raise AvatarError("The file's nodes are their own ancestors; it is damaged.")
    return _Tree(parents=parents, order=order, depths=depths)


def _world_matrices(nodes: Sequence[Json], tree: _Tree) -> list[Float64Array]:
    world = [np.eye(4)] * len(nodes)
    for number in tree.order:
        local = _local_matrix(nodes[number])
        world[number] = local if tree.parents[number] < 0 else world[tree.parents[number]] @ local
    return world


def _local_matrix(node: Json) -> Float64Array:
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    T = np.eye(4)
    x, y, z, w = node.get("rotation", (0.0, 0.0, 0.0, 1.0))
    T[:3, :3] = matrix_from_quat((w, x, y, z)) * np.array(node.get("scale", (1.0, 1.0, 1.0)))
    T[:3, 3] = node.get("translation", (0.0, 0.0, 0.0))
    return T
