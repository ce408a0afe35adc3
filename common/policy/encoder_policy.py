"""A policy of two graphs: an encoder from image to latent, a head from latents, ego-motion and goal to the command."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.messages.checks import check_array
from readygo.common.policy.artifact import Fusion, PolicySpec
from readygo.common.policy.memory import PolicyMemory
from readygo.common.policy.motion import motion_features
from readygo.common.policy.policy import Policy
from readygo.common.policy.sight import channels_by_image, graph_input


class EncoderPolicy(Policy):
    """A policy that remembers latents of images, or with early fusion the images."""

    def __init__(self, spec: PolicySpec, encoder: Any, head: Any) -> None:
        """Keep the sessions of both graphs; `load_policy` makes a policy from files.

        Args:
            spec: What it was trained for.
            encoder: onnxruntime's session of the graph from image to latent.
            head: That of the graph from latents, ego-motion and goal to the command.
        """
        super().__init__(spec)
        self._encoder = encoder
        self._channels = channels_by_image(spec.inputs.images, spec.inputs.frames_together)
        self._head = head

    def remembered_image(self, images: npt.NDArray[np.uint8]) -> npt.NDArray[Any]:
        """Latents, shape (B, L); with early fusion the images themselves."""
        return images if self.spec.inputs.fusion is Fusion.EARLY else self.encode(images)

    def decide(
        self,
        memories: Sequence[PolicyMemory],
        commands: npt.NDArray[np.float32],
        goals_xy_m: npt.NDArray[np.float32],
    ) -> npt.NDArray[np.float32]:
        """Commands v [m/s], w [rad/s] within the robot's limits, shape (B, 2)."""
        return self._answer(self.features(memories, commands, goals_xy_m), [memory.traits for memory in memories])

    def encode(self, images: npt.NDArray[np.uint8]) -> npt.NDArray[np.float32]:
        """Latents of RGB images, shape (B, L).

        Images go through one at a time: the sums of a batch are grouped differently, and an episode's result would
        depend on which other episodes run beside it.

        Args:
            images: What the encoder takes, `PolicyInputs.images` side by side, shape (B, H, W, C); all frames stacked
                with early fusion.

        Raises:
            PolicyError: If the images do not have the size that the policy was trained for.
        """
        inputs = self.spec.inputs
        self.check_images(images, inputs.frames_together)
        latents = np.empty((len(images), inputs.latent_count), np.float32)
        for row in range(len(images)):
            latents[row] = self._encoder.run(None, self._fed(images[row : row + 1]))[0][0]
        return latents

    def act(
        self,
        latents: npt.NDArray[np.float32],
        motion: npt.NDArray[np.float32],
        goals_xy_m: npt.NDArray[np.float32],
        traits: npt.NDArray[np.float32] | None = None,
    ) -> npt.NDArray[np.float32]:
        """Actions of several episodes.

        Args:
            latents: One row per episode, with late fusion those of all frames, shape (B, `latents_width`).
            motion: Features of own motion, see `MotionInput`, shape (B, M).
            goals_xy_m: Goals in the robots' frames (x forward, y left) [m], shape (B, 2).
            traits: Robot parameters, for a policy that knows several, shape (B, TRAIT_COUNT); of its robot by default.

        Returns:
            Commands v [m/s], w [rad/s] within the robot's limits, shape (B, 2).
        """
        features = np.concatenate([latents, motion, goals_xy_m], axis=1).astype(np.float32)
        return self._answer(features, [self.start().traits] * len(features) if traits is None else list(traits))

    def features(
        self,
        memories: Sequence[PolicyMemory],
        commands: npt.NDArray[np.float32],
        goals_xy_m: npt.NDArray[np.float32],
    ) -> npt.NDArray[np.float32]:
        """What the head is given to `decide`: latents, own motion and goal in SI units, shape (B, `feature_count`).

        Args:
            memories: What `start` returned, one per episode.
            commands: Commands executed over the last step: v [m/s], w [rad/s], shape (B, 2).
            goals_xy_m: Goals in the robots' frames (x forward, y left) [m], shape (B, 2).
        """
        own = [memory.own_motion(command) for memory, command in zip(memories, commands, strict=True)]
        motion = motion_features(self.spec.inputs.motion, np.stack(own))
        if self.spec.inputs.fusion is Fusion.EARLY:
            latents = self.encode(np.stack([np.concatenate(memory.window(), axis=2) for memory in memories]))
        else:
            latents = np.stack([np.concatenate(memory.window()) for memory in memories])
        features: npt.NDArray[np.float32] = np.concatenate([latents, motion, goals_xy_m], axis=1).astype(np.float32)
        return features

    def _fed(self, images: npt.NDArray[np.uint8]) -> dict[str, npt.NDArray[np.uint8]]:
        """Images by the names of the encoder's inputs."""
        if len(self._channels) == 1:
            return {"image": images}
        return {graph_input(name): images[..., where] for name, where in self._channels.items()}

    def _answer(
        self, features: npt.NDArray[np.float32], traits: Sequence[npt.NDArray[np.float32]]
    ) -> npt.NDArray[np.float32]:
        check_array("features", features, np.float32, (None, self.spec.inputs.feature_count))
        fed = [{"features": row[None]} for row in features]
        if self.spec.inputs.robot:
            fed = [given | {"robot": told[None]} for given, told in zip(fed, traits, strict=True)]
        rows = [self._head.run(None, given)[0] for given in fed]
        return np.concatenate(rows) if rows else np.empty((0, 2), np.float32)
