import math
import struct
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.avatars import SMPL_PARENTS
from readygo.common.avatars.importers.gltf_file import GltfFile
from readygo.common.avatars.importers.gltf_human import gltf_human
from readygo.common.avatars.importers.gltf_scene import read_figure
from readygo.common.avatars.importers.joints import JOINT
from readygo.common.errors import AvatarError
from tests.common.avatars.importers.humans import boxes, tpose_joints_m, write_glb


def test_bones_and_skin_lie_where_the_inverse_bind_matrices_say(tmp_path: Path) -> None:
    M = np.diag([0.01, 0.01, 0.01, 1.0])
    figure = read_figure(GltfFile(write_glb(tmp_path / "a.glb", M_world_bind=M, posed=True)))
    bones = figure.bones
    place = {node: k for k, node in enumerate(bones.nodes)}
    of_joint = [place[joint + 1] for joint in range(24)]
    np.testing.assert_allclose(bones.heads[of_joint], 100.0 * tpose_joints_m(), atol=1e-3)
    assert bones.names[of_joint[0]] == "mixamorig:Hips"
    assert [bones.nodes[bones.parents[k]] for k in of_joint[1:]] == (SMPL_PARENTS[1:] + 1).tolist()
    assert (bones.parents < np.arange(len(bones.parents))).all()
    assert figure.scale == pytest.approx(0.01)
    (part,) = figure.parts
    vertices, _, owners, triangles = boxes()
    np.testing.assert_allclose(part.positions, 100.0 * vertices, atol=1e-3)
    np.testing.assert_array_equal(part.triangles, triangles)
    np.testing.assert_array_equal(part.bone_index[:, 0], np.array(of_joint)[owners])
    np.testing.assert_allclose(part.bone_weight.sum(axis=1), 1.0)


def test_mesh_that_hangs_at_a_bone_moves_with_it(tmp_path: Path) -> None:
    def edit(document: dict[str, Any]) -> None:
        document["nodes"].append({"mesh": 0, "translation": [0.0, 0.1, 0.0]})
        document["nodes"][JOINT["head"] + 1].setdefault("children", []).append(len(document["nodes"]) - 1)

    figure = read_figure(GltfFile(write_glb(tmp_path / "a.glb", edit=edit)))
    body, glasses = figure.parts
    assert {figure.bones.nodes[bone] for bone in glasses.bone_index[:, 0]} == {JOINT["head"] + 1}
    offset = tpose_joints_m()[JOINT["head"]] + (0.0, 0.1, 0.0)
    np.testing.assert_allclose(glasses.positions, body.positions + offset, atol=1e-5)


def test_skins_with_bind_poses_of_their_own_come_to_the_first_ones(tmp_path: Path) -> None:
    def edit(document: dict[str, Any]) -> None:
        hat = len(document["nodes"])
        document["nodes"] += [{"name": "hat"}, {"mesh": 1, "skin": 1}]
        document["nodes"][JOINT["head"] + 1].setdefault("children", []).append(hat)
        document["meshes"].append({"primitives": [{"mode": 1, "attributes": {}}]})
        document["skins"].append({"joints": [JOINT["head"] + 1, hat], "inverseBindMatrices": 6})

    M = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
    bones = read_figure(GltfFile(write_glb(tmp_path / "a.glb", M_world_bind=M, edit=edit))).bones
    pelvis, hip, head = (tpose_joints_m()[JOINT[joint]] for joint in ("pelvis", "left_hip", "head"))
    # The second skin's matrices are the first two of the first skin: its hat is to its head as the hip to the pelvis.
    np.testing.assert_allclose(bones.heads[bones.names.index("hat")], M[:3, :3].T @ (head + hip - pelvis), atol=1e-6)


def _without_skin(document: dict[str, Any]) -> None:
    del document["nodes"][0]["skin"]


def _with_long_accessor(document: dict[str, Any]) -> None:
    document["accessors"][0]["count"] = 10**6


def _without_inverses(document: dict[str, Any]) -> None:
    del document["skins"][0]["inverseBindMatrices"]


def _with_few_inverses(document: dict[str, Any]) -> None:
    document["accessors"][6]["count"] = 3


def _without_weights(document: dict[str, Any]) -> None:
    del document["meshes"][0]["primitives"][0]["attributes"]["WEIGHTS_0"]


def _with_few_joints(document: dict[str, Any]) -> None:
    document["skins"][0]["joints"] = document["skins"][0]["joints"][:5]


def _with_few_vertices(document: dict[str, Any]) -> None:
    for number in range(5):
        document["accessors"][number]["count"] = 8


def _scaled_to_nothing(document: dict[str, Any]) -> None:
    document["nodes"].append({"name": "root", "scale": [0, 0, 0], "children": [0, 1]})


def _looped(document: dict[str, Any]) -> None:
    document["nodes"][5]["children"] = [1]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (_without_skin, "has no skin"),
        (_with_long_accessor, "accessor 0 cannot be read"),
        (_without_inverses, "no inverse bind matrices"),
        (_with_few_inverses, "do not fit its 29 joints"),
        (_without_weights, "vertices without joints and weights"),
        (_with_few_joints, "name joints it has not"),
        (_with_few_vertices, "name vertices beyond the 8"),
        (_looped, "their own ancestors"),
        (_scaled_to_nothing, "at no finite place"),
    ],
)
def test_damaged_files_are_refused_in_one_line(tmp_path: Path, edit: Any, message: str) -> None:
    with pytest.raises(AvatarError, match=message) as raised:
        read_figure(GltfFile(write_glb(tmp_path / "p.glb", edit=edit)))
    assert "\n" not in str(raised.value)


def test_weights_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    path = write_glb(tmp_path / "p.glb")
    whole, broken = struct.pack("<8f", *[1, 0, 0, 0] * 2), struct.pack("<8f", *[math.nan, 0, 0, 0] * 2)
    path.write_bytes(path.read_bytes().replace(whole, broken, 1))
    with pytest.raises(AvatarError, match="weights of mesh 0 are not finite"):
        read_figure(GltfFile(path))


def _chain(count: int) -> Any:
    """Adds nodes to a document, each the child of the one before, under the first joint."""

    def edit(document: dict[str, Any]) -> None:
        nodes = document["nodes"]
        first = len(nodes)
        nodes.extend({"children": [first + k + 1]} for k in range(count - 1))
        nodes.append({})
        nodes[1].setdefault("children", []).append(first)

    return edit


def test_long_chain_of_nodes_takes_no_longer_than_its_length(tmp_path: Path) -> None:
    begin_s = time.process_time()
    figure = read_figure(GltfFile(write_glb(tmp_path / "a.glb", edit=_chain(30_000))))
    assert time.process_time() - begin_s < 4.0
    assert len(figure.bones.names) == 29


def test_more_nodes_than_any_figure_has_are_refused(tmp_path: Path) -> None:
    with pytest.raises(AvatarError, match="nodes; at most 65536"):
        read_figure(GltfFile(write_glb(tmp_path / "a.glb", edit=_chain(70_000))))


@pytest.mark.parametrize("children", [[10**6], [-40]])
def test_children_that_are_not_there_are_refused(tmp_path: Path, children: list[int]) -> None:
    def edit(document: dict[str, Any]) -> None:
        document["nodes"][0]["children"] = children

    with pytest.raises(AvatarError, match="has a child"):
        gltf_human(write_glb(tmp_path / "a.glb", edit=edit))


def test_mesh_of_very_many_triangles_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("readygo.common.avatars.importers.gltf_scene.TRIANGLES_MAX", 100)
    with pytest.raises(AvatarError, match="more than 100 triangles"):
        read_figure(GltfFile(write_glb(tmp_path / "a.glb")))


def test_colours_and_coordinates_of_another_size_are_left_out(tmp_path: Path) -> None:
    def edit(document: dict[str, Any]) -> None:
        for primitive in document["meshes"][0]["primitives"]:
            attributes = primitive["attributes"]
            attributes["COLOR_0"] = attributes["TEXCOORD_0"]
            attributes["TEXCOORD_0"] = attributes["POSITION"]

    (part,) = read_figure(GltfFile(write_glb(tmp_path / "a.glb", edit=edit))).parts
    assert part.colours is None
    assert part.uv is None


@pytest.mark.parametrize("joint", [-1, 10**6])
def test_joints_that_are_no_nodes_are_refused(tmp_path: Path, joint: int) -> None:
    def edit(document: dict[str, Any]) -> None:
        document["skins"][0]["joints"][7] = joint

    with pytest.raises(AvatarError, match="joints that are no nodes"):
        read_figure(GltfFile(write_glb(tmp_path / "a.glb", edit=edit)))
