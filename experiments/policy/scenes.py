"""What the place itself is worth in training: policies that learn in it, or in other flats, tried in it.

    python -m experiments.policy.scenes SCENE --out FOLDER [--counts 1 4 16] [--seeds 3] [--episodes 160] [--test 100]

- same: learns in SCENE
- others-N: learns in N other flats, `embedded:plan-0`, `embedded:plan-1`, ..., of other plans, furniture, colours
  and light; as many episodes in each of them as `same` has in SCENE

How they are compared: `experiments.policy.arms`. The policy on states that labels all data learned in SCENE, also for
the arms that never see it.
"""

from collections.abc import Mapping, Sequence

from experiments.policy import arms
from experiments.policy.arms import Arm


def arms_of(scene: str, counts: Sequence[int]) -> Mapping[str, Arm]:
    """The arm of the place itself, and those of other flats."""
    others = {f"others-{n}": Arm(scenes=tuple(f"embedded:plan-{k}" for k in range(n))) for n in counts}
    return {"same": Arm(scenes=(scene,)), **others}


def main() -> None:
    """See the module."""
    parser = arms.parser_of(__doc__)
    parser.add_argument("--counts", type=int, nargs="+", default=[1, 4, 16])
    options = vars(parser.parse_args())
    counts = options.pop("counts")
    arms.main("scenes", options, arms_of(options["scene"], counts))


if __name__ == "__main__":
    main()
