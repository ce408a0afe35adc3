import numpy as np
import pytest

from readygo.benchmarks.motion.cmu import BONES, METRES, pose_of, read_frames, read_skeleton, rotation, smpl_joints

SKELETON = """:units
:bonedata
  begin
     id 1
     name thigh
     direction 0 -1 0
     length 2
     axis 0 0 0  XYZ
     dof rx rz
  end
  begin
     id 2
     name shin
     direction 0 -1 0
     length 1
     axis 0 0 90  XYZ
     dof rx
  end
:hierarchy
  begin
    root thigh
    thigh shin
  end
"""
FRAMES = """#!OML
:FULLY-SPECIFIED
1
root 1 2 3 0 0 0
thigh 90 0
2
root 0 0 0 0 90 0
shin 90
"""


@pytest.fixture
def body(tmp_path):
    (tmp_path / "s.asf").write_text(SKELETON)
    return read_skeleton(tmp_path / "s.asf")


def test_rotation_is_about_x_then_y_then_z():
    assert rotation([90, 0, 0]) @ [0, 1, 0] == pytest.approx([0, 0, 1])
    assert rotation([90, 90, 0]) @ [0, 1, 0] == pytest.approx([1, 0, 0])
    assert rotation([90, 90, 90]) @ [0, 1, 0] == pytest.approx([0, 1, 0])


def test_skeleton_is_read_with_its_order_and_in_metres(body):
    bones, parents = body
    assert parents == {"thigh": "root", "shin": "thigh"}
    assert bones["thigh"].vector_m == pytest.approx([0, -2 * METRES, 0])
    assert (bones["thigh"].dof, bones["shin"].dof) == (["rx", "rz"], ["rx"])


def test_frames_pose_the_bones(body, tmp_path):
    (tmp_path / "s.amc").write_text(FRAMES)
    first, second = read_frames(tmp_path / "s.amc")
    ends, _ = pose_of(*body, first)
    assert ends["root"] == pytest.approx(np.array([1, 2, 3]) * METRES)
    assert ends["thigh"] == pytest.approx(np.array([1, 2, 1]) * METRES)
    assert ends["shin"] == pytest.approx(np.array([1, 2, 0]) * METRES)
    ends, turns = pose_of(*body, second)
    # The shin's own x axis is the body's y; the bone along it stays.
    assert ends["shin"] == pytest.approx(np.array([0, -3, 0]) * METRES)
    assert turns["thigh"] == pytest.approx(rotation([0, 90, 0]))


def test_collars_are_a_third_of_the_way_from_the_chest():
    ends = {name or "root": np.zeros(3) for name in BONES.values()}
    ends["thorax"], ends["lclavicle"] = np.array([0.0, 1.0, 0.0]), np.array([1.0, 1.0, 0.0])
    joints = smpl_joints(ends)
    assert joints[13] == pytest.approx([0.35, 1.0, 0.0])
    assert joints[9] == pytest.approx([0.0, 1.0, 0.0])
