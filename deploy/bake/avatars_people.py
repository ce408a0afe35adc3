"""Who is baked: one row per embedded avatar. Colours are sRGB in 0..1, lengths in metres."""

from dataclasses import dataclass, field

Colour = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Garment:
    """Colour and cut of one piece of clothing."""

    colour: Colour
    second: Colour = (0.9, 0.9, 0.9)
    """Other colour of a pattern."""
    fabric: str = "plain"
    """plain, denim, knit, stripes, breton, checks or twill."""
    offset_m: float = 0.007
    looseness: float = 0.5
    """0 follows the body, 1 hangs wide."""


@dataclass(frozen=True, kw_only=True)
class Person:
    """A body, its colours and its clothes."""

    name: str
    seed: int
    stature_m: float
    phenotype: dict[str, float]
    skin: Colour
    lips: Colour
    hair: Colour
    eyes: Colour
    hair_style: str
    """short, cropped, mop, bob, bun or ponytail."""
    beard: float
    """0 is shaved, 1 is a full beard."""
    top: Garment
    sleeve: float
    """Where the sleeve ends: 0 at the shoulder, 1 at the elbow, 2 at the wrist."""
    closure: str
    """crew, shirt (collar and buttons), polo, open (a jacket over `inner`) or cardigan (open, without a collar)."""
    bottom: Garment
    bottom_kind: str
    """trousers, skirt or shorts."""
    shoes: Garment
    sole: Colour = (0.9, 0.9, 0.88)
    inner: Garment = field(default_factory=lambda: Garment(colour=(0.85, 0.85, 0.85)))
    legs: Garment | None = None
    """Tights under a skirt."""
    hem: float = 0.0
    """How much longer (+) or shorter (-) the top is than to the hip [m]."""
    shape: dict[str, float] = field(default_factory=dict)
    """Changes of body and face by Anny's labels, -1..1; "*-" stands for the left and the right."""
    glasses: Colour | None = None
    """Colour of the frame."""


PEOPLE = (
    Person(
        name="amara",
        seed=11,
        stature_m=1.66,
        phenotype={
            "gender": 1.0,
            "age": 0.60,
            "muscle": 0.5,
            "weight": 0.52,
            "proportions": 0.62,
            "cupsize": 0.5,
            "firmness": 0.6,
            "african": 0.9,
            "asian": 0.0,
            "caucasian": 0.1,
        },
        skin=(0.50, 0.335, 0.245),
        lips=(0.56, 0.23, 0.22),
        hair=(0.055, 0.045, 0.042),
        eyes=(0.16, 0.09, 0.05),
        hair_style="bun",
        beard=0.0,
        top=Garment(colour=(0.80, 0.55, 0.16), fabric="plain", offset_m=0.006, looseness=0.45),
        sleeve=1.45,
        closure="shirt",
        bottom=Garment(colour=(0.14, 0.15, 0.21), fabric="twill", offset_m=0.010),
        bottom_kind="skirt",
        shoes=Garment(colour=(0.42, 0.16, 0.15)),
        sole=(0.12, 0.11, 0.10),
        legs=Garment(colour=(0.125, 0.12, 0.15), offset_m=0.001, looseness=0.0),
        hem=-0.03,
        shape={
            "measure-shoulder-dist-incr": -0.7,
            "*-eye-height2-incr": 0.5,
            "*-eye-scale-incr": 0.35,
            "chin-width-incr": -0.8,
            "head-scale-horiz-incr": -0.25,
            "chin-bones-incr": -0.7,
            "*-cheek-bones-incr": 0.3,
            "nose-scale-horiz-incr": -0.25,
            "mouth-upperlip-volume-incr": 0.3,
            "mouth-angles-up": 0.3,
            "neck-scale-horiz-incr": -0.3,
        },
    ),
    Person(
        name="bruno",
        seed=12,
        stature_m=1.80,
        phenotype={
            "gender": 0.0,
            "age": 0.62,
            "muscle": 0.6,
            "weight": 0.52,
            "proportions": 0.65,
            "cupsize": 0.5,
            "firmness": 0.5,
            "african": 0.0,
            "asian": 0.0,
            "caucasian": 1.0,
        },
        skin=(0.82, 0.62, 0.515),
        lips=(0.69, 0.43, 0.39),
        hair=(0.22, 0.145, 0.09),
        eyes=(0.25, 0.33, 0.38),
        hair_style="short",
        beard=0.35,
        top=Garment(
            colour=(0.58, 0.13, 0.13), second=(0.10, 0.10, 0.13), fabric="checks", offset_m=0.008, looseness=0.6
        ),
        sleeve=1.93,
        closure="shirt",
        bottom=Garment(colour=(0.16, 0.23, 0.36), fabric="denim", offset_m=0.007, looseness=0.6),
        bottom_kind="trousers",
        shoes=Garment(colour=(0.36, 0.22, 0.13)),
        sole=(0.15, 0.11, 0.08),
        hem=0.03,
        shape={
            "measure-shoulder-dist-incr": -0.25,
            "*-eye-height2-incr": 0.35,
            "*-eye-scale-incr": 0.2,
            "nose-scale-vert-incr": 0.2,
            "chin-width-incr": -0.15,
            "head-scale-horiz-incr": -0.15,
        },
    ),
    Person(
        name="clara",
        seed=13,
        stature_m=1.71,
        phenotype={
            "gender": 1.0,
            "age": 0.58,
            "muscle": 0.5,
            "weight": 0.45,
            "proportions": 0.7,
            "cupsize": 0.45,
            "firmness": 0.7,
            "african": 0.0,
            "asian": 0.1,
            "caucasian": 0.9,
        },
        skin=(0.83, 0.64, 0.545),
        lips=(0.74, 0.42, 0.41),
        hair=(0.50, 0.35, 0.20),
        eyes=(0.27, 0.38, 0.30),
        hair_style="bob",
        beard=0.0,
        top=Garment(colour=(0.82, 0.78, 0.70), second=(0.70, 0.65, 0.56), fabric="knit", offset_m=0.011, looseness=0.7),
        sleeve=1.95,
        closure="crew",
        bottom=Garment(colour=(0.25, 0.34, 0.47), fabric="denim", offset_m=0.005, looseness=0.15),
        bottom_kind="trousers",
        shoes=Garment(colour=(0.86, 0.86, 0.85)),
        sole=(0.93, 0.93, 0.92),
        hem=0.05,
        shape={
            "measure-shoulder-dist-incr": -0.3,
            "*-eye-height2-incr": 0.4,
            "*-eye-scale-incr": 0.35,
            "chin-width-incr": -0.4,
            "nose-scale-horiz-incr": -0.2,
            "nose-point-up": 0.3,
            "mouth-angles-up": 0.25,
        },
    ),
    Person(
        name="dae",
        seed=14,
        stature_m=1.74,
        phenotype={
            "gender": 0.0,
            "age": 0.55,
            "muscle": 0.5,
            "weight": 0.45,
            "proportions": 0.6,
            "cupsize": 0.5,
            "firmness": 0.5,
            "african": 0.0,
            "asian": 1.0,
            "caucasian": 0.0,
        },
        skin=(0.76, 0.58, 0.45),
        lips=(0.66, 0.42, 0.37),
        hair=(0.06, 0.052, 0.05),
        eyes=(0.13, 0.08, 0.05),
        hair_style="short",
        beard=0.0,
        top=Garment(colour=(0.20, 0.25, 0.24), fabric="twill", offset_m=0.013, looseness=0.8),
        sleeve=1.96,
        closure="open",
        inner=Garment(colour=(0.84, 0.84, 0.82), fabric="plain"),
        bottom=Garment(colour=(0.56, 0.49, 0.38), fabric="twill", offset_m=0.007, looseness=0.5),
        bottom_kind="trousers",
        shoes=Garment(colour=(0.23, 0.25, 0.29)),
        sole=(0.88, 0.88, 0.86),
        hem=0.05,
        shape={
            "measure-shoulder-dist-incr": -0.2,
            "*-eye-height2-incr": 0.55,
            "*-eye-scale-incr": 0.25,
            "chin-width-incr": -0.25,
            "mouth-angles-up": 0.15,
        },
    ),
    Person(
        name="elif",
        seed=15,
        stature_m=1.60,
        phenotype={
            "gender": 1.0,
            "age": 0.55,
            "muscle": 0.45,
            "weight": 0.6,
            "proportions": 0.5,
            "cupsize": 0.6,
            "firmness": 0.6,
            "african": 0.0,
            "asian": 0.35,
            "caucasian": 0.65,
        },
        skin=(0.72, 0.52, 0.40),
        lips=(0.66, 0.36, 0.35),
        hair=(0.13, 0.075, 0.05),
        eyes=(0.19, 0.12, 0.07),
        hair_style="ponytail",
        beard=0.0,
        top=Garment(
            colour=(0.90, 0.90, 0.88), second=(0.12, 0.16, 0.30), fabric="breton", offset_m=0.006, looseness=0.5
        ),
        sleeve=1.6,
        closure="crew",
        bottom=Garment(colour=(0.10, 0.10, 0.115), fabric="twill", offset_m=0.006, looseness=0.35),
        bottom_kind="trousers",
        shoes=Garment(colour=(0.62, 0.17, 0.17)),
        sole=(0.92, 0.91, 0.89),
        hem=0.02,
        shape={
            "measure-shoulder-dist-incr": -0.35,
            "*-eye-height2-incr": 0.5,
            "*-eye-scale-incr": 0.35,
            "chin-width-incr": -0.35,
            "nose-scale-horiz-incr": -0.2,
            "mouth-angles-up": 0.3,
            "*-cheek-volume-incr": 0.3,
        },
    ),
    Person(
        name="femi",
        seed=16,
        stature_m=1.88,
        phenotype={
            "gender": 0.0,
            "age": 0.68,
            "muscle": 0.6,
            "weight": 0.68,
            "proportions": 0.6,
            "cupsize": 0.5,
            "firmness": 0.5,
            "african": 0.85,
            "asian": 0.0,
            "caucasian": 0.15,
        },
        skin=(0.43, 0.29, 0.215),
        lips=(0.43, 0.26, 0.23),
        hair=(0.07, 0.062, 0.06),
        eyes=(0.12, 0.07, 0.04),
        hair_style="cropped",
        beard=0.8,
        top=Garment(colour=(0.17, 0.36, 0.50), fabric="plain", offset_m=0.007, looseness=0.6),
        sleeve=0.62,
        closure="polo",
        bottom=Garment(colour=(0.32, 0.33, 0.35), fabric="twill", offset_m=0.008, looseness=0.7),
        bottom_kind="trousers",
        shoes=Garment(colour=(0.14, 0.14, 0.15)),
        sole=(0.80, 0.80, 0.80),
        hem=0.02,
        shape={
            "measure-shoulder-dist-incr": -0.25,
            "*-eye-height2-incr": 0.45,
            "*-eye-scale-incr": 0.2,
            "stomach-pregnant-incr": 0.12,
            "mouth-angles-up": 0.15,
        },
    ),
    Person(
        name="gil",
        seed=17,
        stature_m=1.25,
        phenotype={
            "gender": 0.0,
            "age": 0.26,
            "muscle": 0.45,
            "weight": 0.48,
            "proportions": 0.6,
            "cupsize": 0.5,
            "firmness": 0.5,
            "african": 0.1,
            "asian": 0.1,
            "caucasian": 0.8,
        },
        skin=(0.80, 0.61, 0.50),
        lips=(0.74, 0.46, 0.43),
        hair=(0.34, 0.215, 0.12),
        eyes=(0.22, 0.25, 0.20),
        hair_style="mop",
        beard=0.0,
        top=Garment(
            colour=(0.25, 0.50, 0.30), second=(0.93, 0.80, 0.25), fabric="breton", offset_m=0.006, looseness=0.6
        ),
        sleeve=0.72,
        closure="crew",
        bottom=Garment(colour=(0.28, 0.31, 0.40), fabric="twill", offset_m=0.008, looseness=1.0),
        bottom_kind="shorts",
        shoes=Garment(colour=(0.16, 0.30, 0.58)),
        sole=(0.93, 0.93, 0.91),
        hem=0.02,
        shape={"*-eye-height2-incr": 0.5, "mouth-angles-up": 0.7, "eyebrows-trans-up": 0.3, "eyebrows-angle-up": 0.3},
    ),
    Person(
        name="hana",
        seed=18,
        stature_m=1.57,
        phenotype={
            "gender": 1.0,
            "age": 0.93,
            "muscle": 0.4,
            "weight": 0.62,
            "proportions": 0.45,
            "cupsize": 0.6,
            "firmness": 0.3,
            "african": 0.0,
            "asian": 0.8,
            "caucasian": 0.2,
        },
        skin=(0.79, 0.63, 0.525),
        lips=(0.68, 0.43, 0.41),
        hair=(0.66, 0.65, 0.64),
        eyes=(0.16, 0.10, 0.07),
        hair_style="bob",
        beard=0.0,
        top=Garment(colour=(0.47, 0.25, 0.36), second=(0.40, 0.20, 0.30), fabric="knit", offset_m=0.013, looseness=0.6),
        sleeve=1.93,
        closure="cardigan",
        inner=Garment(colour=(0.88, 0.84, 0.77)),
        bottom=Garment(colour=(0.36, 0.36, 0.37), fabric="twill", offset_m=0.008, looseness=0.8),
        bottom_kind="trousers",
        shoes=Garment(colour=(0.22, 0.17, 0.15)),
        sole=(0.17, 0.14, 0.13),
        hem=0.08,
        shape={
            "measure-shoulder-dist-incr": -0.4,
            "head-age-incr": 0.35,
            "*-eye-height2-incr": 0.8,
            "*-eye-scale-incr": 0.3,
            "mouth-angles-up": 0.3,
            "torso-trans-forward": 0.1,
        },
        glasses=(0.40, 0.29, 0.24),
    ),
)
