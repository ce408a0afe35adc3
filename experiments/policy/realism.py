"""What people in training are worth: policies that differ in who walks in their data.

    python -m experiments.policy.realism SCENE --out FOLDER [--seeds 3] [--episodes 160] [--test 100]

- photoreal: varied avatars (`readygo avatar vary embedded:train`) who walk
- mesh: the same people as simple assets of a game engine ([renderer] human_look = "mesh"), as in Vid2Sim
- standing: the same photoreal people, who stand
- absent: no people

`--arms photoreal standing` compares some of them alone. How they are compared: `experiments.policy.arms`.
"""

from collections.abc import Mapping

from experiments.policy import arms
from experiments.policy.arms import Arm

STANDING = (
    "[episode]\nhuman_count_min = 0\nhuman_count_max = 0\n\n[human_planner]\nstanding_min = 2\nstanding_max = 4\n"
)


def arms_in(scene: str) -> Mapping[str, Arm]:
    """The arms, all of which learn in one scene."""
    return {
        "photoreal": Arm(scenes=(scene,)),
        "mesh": Arm(scenes=(scene,), settings='[renderer]\nhuman_look = "mesh"\n'),
        "standing": Arm(scenes=(scene,), settings=STANDING, crowded=False),
        "absent": Arm(scenes=(scene,), settings="[human_planner]\nabsent = 1.0\n", crowded=False),
    }


def main() -> None:
    """See the module."""
    options = vars(arms.parser_of(__doc__).parse_args())
    arms.main("realism", options, arms_in(options["scene"]))


if __name__ == "__main__":
    main()
