"""Choices of the Triton kernels that change speed, not images."""

from dataclasses import dataclass, replace

from readygo.common.errors import ReadygoError

TILE_SIZES_PX = (4, 8, 16, 32)
TILES_MAX = 255
"""Most tiles along an axis: kernels pack their numbers, and the one after the last, into 8 bits."""
WARPS_MAX = 32
"""Most warps of a program on any GPU."""


@dataclass(frozen=True, kw_only=True)
class TritonSettings:
    """Defaults come from counting instructions (README.md); `readygo.benchmarks.rasterizer.gpu` tries others."""

    tile_width_px: int = 16
    tile_height_px: int = 8
    slab_shares: tuple[float, ...] = (0.1, 0.25, 0.5)
    """Shares of a camera's visible chunks, nearest first, at which one slab of depth ends and the next begins. What
    lies behind finished tiles is neither projected nor sorted in later slabs."""
    cameras_per_pass: int = 64
    """Cameras that share the buffers; memory grows with it, launches per image shrink."""
    programs_per_processor: int = 8
    """Programs of the kernels that share a list of unknown length, per multiprocessor."""
    sort_run: int = 256
    """Entries of a tile's list that are sorted in registers; longer lists are merged from such runs."""
    long_sort_run: int = 1024
    """Entries sorted in registers at once for lists longer than this, such as those of tiles full of a human."""
    project_warps: int = 8
    sort_warps: int = 1
    long_sort_warps: int = 4
    blend_warps: int = 1

    def __post_init__(self) -> None:
        for name in ("tile_width_px", "tile_height_px"):
            if getattr(self, name) not in TILE_SIZES_PX:
                raise ValueError(f"{name} must be one of {TILE_SIZES_PX}, got {getattr(self, name)}.")
        for name in ("sort_run", "long_sort_run"):
            if getattr(self, name) < 2 or getattr(self, name) & (getattr(self, name) - 1):
                raise ValueError(f"{name} must be a power of two above 1, got {getattr(self, name)}.")
        shares = self.slab_shares
        if list(shares) != sorted(shares) or not all(0 < share < 1 for share in shares):
            raise ValueError(f"slab_shares must be rising numbers between 0 and 1, got {shares}.")
        launches = "project_warps", "sort_warps", "long_sort_warps", "blend_warps"
        for name in ("cameras_per_pass", "programs_per_processor", *launches):
            if getattr(self, name) < 1:
                raise ValueError(f"{name} must be at least 1, got {getattr(self, name)}.")

    def for_image(self, height_px: int, width_px: int) -> "TritonSettings":
        """These settings with tiles as large as an image needs, and as many pixels per warp as before.

        Args:
            height_px: Image height.
            width_px: Image width.

        Raises:
            ReadygoError: If the largest tiles are too small for the image.
        """
        if max(height_px, width_px) > TILES_MAX * TILE_SIZES_PX[-1]:
            raise ReadygoError(
                f"The backend triton draws images of up to {TILES_MAX * TILE_SIZES_PX[-1]} px a side, got "
                f"{height_px}x{width_px} px; use the cpu backend, or a smaller image."
            )
        height, width = self.tile_height_px, self.tile_width_px
        while -(-height_px // height) > TILES_MAX:
            height *= 2
        while -(-width_px // width) > TILES_MAX:
            width *= 2
        larger = height * width // (self.tile_height_px * self.tile_width_px)
        return replace(
            self, tile_height_px=height, tile_width_px=width, blend_warps=min(self.blend_warps * larger, WARPS_MAX)
        )
