"""Which bone is which SMPL joint, by name.

Knows the conventions of Mixamo, Ready Player Me, VRM and VRoid, Blender's Rigify, Unreal's mannequin, MakeHuman,
3ds Max Biped, Character Creator, Daz and SMPL, and what generic rigs have in common with them.
"""

import re
from collections.abc import Mapping, Sequence

from readygo.common.arrays import Int64Array

_TOKENS = re.compile(r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z]+|[A-Z]+")
_LEFT, _RIGHT = ("l", "left", "lft", "lf"), ("r", "right", "rgt", "rt")
_NOISE = frozenset(
    {"mixamorig", "def", "org", "bip", "valve", "biped", "j", "c", "cc", "ccbase", "base", "armature", "rig", "bone"}
    | {"jnt", "joint", "bn", "sk", "skel", "m", "f", "g", "b", "avg", "smpl", "genesis", "character", "human", "body"}
    | {"male", "female"}
)
_LIMB_WORDS: Mapping[str, frozenset[str]] = {
    "hip": frozenset(["upleg", "upperleg", "thigh", "thighbend", "legupper", "femur", "hip"]),
    "knee": frozenset(["lowerleg", "lowleg", "loleg", "calf", "shin", "knee", "leglower", "tibia"]),
    "ankle": frozenset(["ankle", "feet"]),
    "foot": frozenset(["toe", "toes", "ball", "toebone"]),
    "collar": frozenset(["clavicle", "collar", "collarbone", "clav", "scapula"]),
    "shoulder": frozenset(["upperarm", "uparm", "armupper", "shldr", "shldrbend", "bicep", "humerus"]),
    "elbow": frozenset(["lowerarm", "lowarm", "loarm", "forearm", "forearmbend", "elbow", "armlower"]),
    "wrist": frozenset(("wrist",)),
    "hand": frozenset(["handmiddle", "middle", "middleproximal", "fingermiddle", "fmiddle", "palmmiddle"]),
}
_PELVIS, _HEAD = ("hips", "pelvis", "hip"), ("head",)
_NECK = ("neck", "necklower")
VRM_JOINTS: Mapping[str, str] = {
    "hips": "pelvis", "neck": "neck", "head": "head",
    **{
        f"{side}{bone}": f"{side}_{joint}"
        for side in ("left", "right")
        for bone, joint in {
            "UpperLeg": "hip", "LowerLeg": "knee", "Foot": "ankle", "Toes": "foot", "Shoulder": "collar",
            "UpperArm": "shoulder", "LowerArm": "elbow", "Hand": "wrist", "MiddleProximal": "hand",
        }.items()
    },
}  # fmt: skip
"""Bones of the VRM humanoid extensions -> SMPL joints; the spine follows from the chain between pelvis and neck."""


def side_and_word(name: str) -> tuple[str, str]:
    """The side of a bone ("left", "right" or "") and what is left of its name without side, numbers and prefixes."""
    words, side = [], ""
    for token in _TOKENS.findall(name):
        word = token.lower()
        for start, value in (("left", "left"), ("right", "right")):
            if word.startswith(start) and len(word) > len(start):
                side, word = side or value, word[len(start) :]
        if word in _LEFT and not side:
            side = "left"
        elif word in _RIGHT and not side:
            side = "right"
        else:
            words.append(word)
    return side, "".join(word for word in words if word not in _NOISE) or "".join(words)


def joints_by_name(names: Sequence[str], parents: Int64Array) -> dict[str, int]:
    """SMPL joints without those of the spine -> bones; where several fit, the one nearest to the root.

    Args:
        names: Names of the bones, parents before children.
        parents: Bone above each, -1 for none.
    """
    words = [side_and_word(name) for name in names]
    found: dict[str, int] = {}
    for side in ("left", "right"):
        for part, bone in _limb_bones([word if its == side else "" for its, word in words]).items():
            found[f"{side}_{part}"] = bone
    middle = [word if side == "" else "" for side, word in words]
    for joint, known in (("pelvis", _PELVIS), ("neck", _NECK), ("head", _HEAD)):
        first = _first(middle, known)
        if first is not None:
            found[joint] = first
    if "head" not in found:
        found |= _numbered_spine(middle, parents, found)
    if "pelvis" not in found and "left_hip" in found and "right_hip" in found:
        meeting = _meeting(found["left_hip"], found["right_hip"], parents)
        found |= {} if meeting is None else {"pelvis": meeting}
    return found


def joints_of_humanoid(extensions: Mapping[str, object], nodes: Sequence[int]) -> dict[str, int]:
    """SMPL joints -> bones as a VRM extension (0.x or 1.0) names them; empty if there is none."""
    place = {node: bone for bone, node in enumerate(nodes)}
    found = {}
    for key in ("VRMC_vrm", "VRM"):
        extension = extensions.get(key)
        humanoid = extension.get("humanoid", {}) if isinstance(extension, Mapping) else {}
        bones = humanoid.get("humanBones", {}) if isinstance(humanoid, Mapping) else {}
        named: dict[str, object] = dict(bones) if isinstance(bones, Mapping) else {}
        # Version 0 has a list; an entry that names nothing is left out.
        for entry in bones if isinstance(bones, list) else ():
            named |= {str(entry.get("bone")): entry} if isinstance(entry, Mapping) else {}
        for name, entry in named.items():
            node = entry.get("node") if isinstance(entry, Mapping) else None
            if name in VRM_JOINTS and isinstance(node, int) and node in place:
                found[VRM_JOINTS[name]] = place[node]
    return found


def chain_between(start: int, end: int, parents: Int64Array) -> list[int]:
    """Bones strictly between an ancestor and a descendant, from the ancestor on; empty if it is none."""
    chain = []
    bone = int(parents[end])
    while bone not in (start, -1):
        chain.append(bone)
        bone = int(parents[bone])
    return chain[::-1] if bone == start else []


def _limb_bones(words: Sequence[str]) -> dict[str, int]:
    """Parts of one side's limbs; "leg", "foot", "shoulder" and "hand" mean what their neighbours leave to them."""
    limbs = ((part, _first(words, known)) for part, known in _LIMB_WORDS.items())
    found = {part: bone for part, bone in limbs if bone is not None}
    plain = {word: _first(words, (word,)) for word in ("leg", "foot", "arm", "shoulder", "hand")}

    def fill(part: str, word: str) -> None:
        bone = plain[word]
        if bone is not None and part not in found:
            found[part] = bone

    fill("knee" if "hip" in found else "hip", "leg")
    fill("foot" if "ankle" in found else "ankle", "foot")
    has_upper_arm = "shoulder" in found or plain["arm"] is not None
    fill("collar" if has_upper_arm and "collar" not in found else "shoulder", "shoulder")
    fill("shoulder", "arm")
    fill("hand" if "wrist" in found else "wrist", "hand")
    return found


def _numbered_spine(words: Sequence[str], parents: Int64Array, found: Mapping[str, int]) -> dict[str, int]:
    """Rigify's spine: one chain of "spine" from the pelvis to the head; arms leave it below the neck."""
    spine = [bone for bone, word in enumerate(words) if word == "spine"]
    if len(spine) < 4:
        return {}
    named = {"head": spine[-1]}
    if "pelvis" not in found:
        named["pelvis"] = spine[0]
    collar = found.get("left_collar", found.get("left_shoulder"))
    if collar is not None and "neck" not in found:
        branch = int(parents[collar])
        above = [bone for bone in spine[1:-1] if branch in spine and bone > branch]
        if above:
            named["neck"] = above[0]
    return named


def _meeting(first: int, second: int, parents: Int64Array) -> int | None:
    """The nearest bone above both."""
    above = []
    while first >= 0:
        above.append(first)
        first = int(parents[first])
    while second >= 0 and second not in above:
        second = int(parents[second])
    return second if second >= 0 else None


def _first(words: Sequence[str], known: Sequence[str] | frozenset[str]) -> int | None:
    return next((bone for bone, word in enumerate(words) if word in known), None)
