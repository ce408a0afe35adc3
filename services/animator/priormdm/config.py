"""Settings of the `priormdm` motion source; light to import."""

from dataclasses import dataclass
from typing import Literal


@dataclass(frozen=True, kw_only=True)
class PriorMdmConfig:
    """A released motion diffusion model and how to sample from it; the files are the user's own."""

    weights: str = ""
    """State dict of the model, with its args.json beside it; PriorMDM's is
    root_horizontal_finetuned/model000280000.pt."""
    mean: str = ""
    """HumanML3D's Mean.npy (not t2m_mean.npy, which belongs to the evaluator)."""
    std: str = ""
    """HumanML3D's Std.npy."""
    text_embedding: str = ""
    """CLIP ViT-B/32 embedding of a text, e.g. "a person walks", as .npy of 512 numbers; empty samples without text."""
    sampler: Literal["ddpm", "ddim"] = "ddpm"
    """ddpm draws noise at every step, as the release does; ddim needs fewer steps."""
    steps: int = 0
    """Diffusion steps, spread evenly over the trained ones; 0 takes all of them."""
    refine: Literal["none", "limits", "prior"] = "none"
    """Optimise the fitted rotations: within limits of knees and elbows and smooth, or likely under the pose prior.
    It takes seconds per motion."""
    pose_prior: str = ""
    """SMPLify's gmm_08.pkl, or an .npz with means, covars and weights, for refine = "prior"."""
    device: str = "cpu"
    """torch device."""
    sha256: str = ""
    """Digest of the files (`files_digest`); other files are refused. Empty accepts any."""

    def __post_init__(self) -> None:
        if not 0 <= self.steps <= 10_000:
            raise ValueError(f"priormdm.steps must be within 0..10000, got {self.steps}.")
        if self.refine not in ("none", "limits", "prior"):
            raise ValueError(f'priormdm.refine must be "none", "limits" or "prior", got {self.refine!r}.')
        if (self.refine == "prior") != bool(self.pose_prior):
            raise ValueError(
                'priormdm.refine = "prior" and priormdm.pose_prior go together: name the file (gmm_08.pkl of SMPLify, '
                'from smplify.is.tue.mpg.de), or set refine = "limits" without one.'
            )

    def check_named(self) -> None:
        """Check that the files that the model consists of are named.

        Raises:
            ValueError: If one of them is not named.
        """
        missing = [name for name in ("weights", "mean", "std") if not getattr(self, name)]
        if missing:
            raise ValueError(
                f'source "priormdm" needs the user\'s files, not set: {", ".join("priormdm." + n for n in missing)}; '
                "weights (.pt) with args.json come from the release of github.com/priorMDM/priorMDM "
                "(root_horizontal_finetuned), mean and std are Mean.npy and Std.npy of "
                'github.com/EricGuo5513/HumanML3D; or set source = "gait".'
            )
