import json

from readygo.common.avatars.importers import ImportReport, SkeletonReport


def test_report_survives_json_with_all_it_says() -> None:
    skeleton = SkeletonReport(
        bone_of_joint={"pelvis": "Hips"}, estimated=("neck",), merged={"Thumb": "left_hand"}, source="names"
    )
    report = ImportReport(
        kind="glTF figure", name="ann", license="CC0", gaussians=5, height_m=1.7, scale=0.01, skeleton=skeleton,
        notes=("No texture.",),
    )  # fmt: skip
    assert json.loads(json.dumps(report.as_json())) == {
        "kind": "glTF figure",
        "name": "ann",
        "license": "CC0",
        "gaussians": 5,
        "height_m": 1.7,
        "scale": 0.01,
        "skeleton": {
            "source": "names",
            "bone_of_joint": {"pelvis": "Hips"},
            "estimated": ["neck"],
            "merged": {"Thumb": "left_hand"},
        },
        "notes": ["No texture."],
    }


def test_report_of_a_body_without_a_foreign_skeleton_has_none() -> None:
    report = ImportReport(kind="SMPL model", name="a", license="CC0", gaussians=5, height_m=1.7, scale=1.0)
    assert report.as_json()["skeleton"] is None
