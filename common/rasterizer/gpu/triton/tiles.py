# mypy: disable-error-code="no-untyped-def, no-untyped-call"
# Triton's compiler reads the annotations of a kernel: only `tl.constexpr` may stand there.
"""Triton kernels that spread projected Gaussians to lists per tile and sort each list by depth.

An entry is depth bits << 32 | slot: sorted as a number it is sorted by depth, and equal depths by the Gaussian's place
in the scene, so the order in which atomic counters fill the lists does not matter. A rect is the tiles that a Gaussian
touches, x0 | y0 << 8 | x1 << 16 | y1 << 24, both ends included.
"""

import triton
import triton.language as tl

from readygo.common.rasterizer.gpu.triton.project import LANE_BITS, UNSEEN

_UNSEEN = tl.constexpr(UNSEEN)
_CHUNK = tl.constexpr(1 << LANE_BITS)
_DEPTH_SHIFT = tl.constexpr(32)
"""Where an entry's depth bits begin."""
_LAST = tl.constexpr(0x7FFFFFFFFFFFFFFF)
"""Sorted behind every entry."""


@triton.jit(do_not_specialize=["capacity", "entry_capacity", "instance_count"])
def bin_entries(
    pairs, pair_total, capacity, rects, depths, alive, starts, counts, entries, entry_capacity, instance_count,
    WRITE: tl.constexpr, COLUMNS: tl.constexpr, ROWS: tl.constexpr,
):  # fmt: skip
    """Count the entries of each tile, or write them; any number of programs share the pairs.

    Args:
        pairs: Numbers of the instances, camera * I + instance, shape (capacity,).
        pair_total: Number of pairs, shape (1,).
        capacity: Room for pairs.
        rects: Tiles of each Gaussian, packed as boxes are, or UNSEEN, shape (capacity * 256,).
        depths: Depth of each Gaussian [m], shape (capacity * 256,).
        alive: 1 for tiles with an unfinished pixel, shape (B, T).
        starts: Where each tile's list begins, int64, shape (B * T,); not read when counting.
        counts: Raised by one per entry, int32, zeros at first, shape (B * T,).
        entries: Written with WRITE: the lists, int64, shape (entry_capacity,).
        entry_capacity: Room for entries; what exceeds it is left out.
        instance_count: Instances per camera, I.
        WRITE: Write entries.
        COLUMNS: Tiles along an image row.
        ROWS: Tiles along an image column.
    """
    lane = tl.arange(0, _CHUNK)
    total = tl.minimum(tl.load(pair_total), capacity)
    for pair in range(tl.program_id(0), total, tl.num_programs(0)):
        first_tile = (tl.load(pairs + pair) // instance_count) * (COLUMNS * ROWS)
        slot = (lane + pair * _CHUNK).to(tl.int64)
        rect = tl.load(rects + slot)
        seen = rect != _UNSEEN
        x0, y0 = rect & 0xFF, (rect >> 8) & 0xFF
        wide = ((rect >> 16) & 0xFF) - x0 + 1
        # Tiles of each Gaussian's rect; below, each lane goes through its own, row by row.
        size = tl.where(seen, wide * (((rect >> 24) & 0xFF) - y0 + 1), 0)
        tile = first_tile + y0 * COLUMNS + x0
        entry = slot
        if WRITE:
            bits = tl.load(depths + slot, mask=seen, other=0.0).to(tl.int32, bitcast=True)
            entry = (bits.to(tl.int64) << _DEPTH_SHIFT) | slot
        column = tl.zeros_like(rect)
        for k in range(tl.max(size, axis=0)):
            due = k < size
            due = due & (tl.load(alive + tile, mask=due, other=0) != 0)
            place = tl.atomic_add(counts + tile, 1, mask=due, sem="relaxed")
            if WRITE:
                target = tl.load(starts + tile, mask=due, other=0) + place
                tl.store(entries + target, entry, mask=due & (target < entry_capacity))
            # The next tile: one to the right, or the first one of the row below.
            column += 1
            at_end = column == wide
            tile += tl.where(at_end, COLUMNS + 1 - wide, 1)
            column = tl.where(at_end, 0, column)


@triton.jit(do_not_specialize=["entry_capacity", "least", "most"])
def sort_lists(entries, spare, starts, counts, entry_capacity, in_spare, least, most, RUN: tl.constexpr):
    """Sort the lists of `least` to `most` entries, one per program; programs (B * T,).

    Runs of RUN entries are sorted in registers, then merged two by two: an entry's place in the merged run is its place
    in its own run plus the number of smaller entries in the other one, found by bisection.

    Args:
        entries: Lists, int64, shape (entry_capacity,).
        spare: Scratch memory, shape (entry_capacity,).
        starts: Where each list begins, shape (B * T,).
        counts: Entries of each list, shape (B * T,).
        entry_capacity: Room for entries.
        in_spare: Written: 1 for lists whose sorted form is in `spare`, int32, shape (B * T,).
        least: Shorter lists are left alone.
        most: Longer lists are left alone.
        RUN: Entries that are sorted in registers, a power of two.
    """
    tile = tl.program_id(0)
    start = tl.load(starts + tile)
    count = tl.minimum(tl.load(counts + tile), tl.maximum(entry_capacity - start, 0)).to(tl.int32)
    lane = tl.arange(0, RUN)
    if (count >= least) & (count <= most):
        swapped = 0
        for first in range(0, count, RUN):
            inside = first + lane < count
            keys = tl.sort(tl.load(entries + start + first + lane, mask=inside, other=_LAST))
            tl.store(entries + start + first + lane, keys, mask=inside)
        width = 0 + RUN
        while width < count:
            # What other threads of the program have written is visible after a barrier.
            tl.debug_barrier()
            if swapped == 0:
                _merge_runs(entries + start, spare + start, width, count, lane, RUN)
            else:
                _merge_runs(spare + start, entries + start, width, count, lane, RUN)
            swapped = 1 - swapped
            width *= 2
        tl.store(in_spare + tile, swapped)


@triton.jit
def _merge_runs(source, target, width, count, lane, RUN: tl.constexpr):
    """Merge runs of `width` entries two by two.

    Place of a key = where its pair of runs begins + its place in its own run + the smaller entries of the other run.
    """
    for first in range(0, count, RUN):
        i = first + lane
        inside = i < count
        key = tl.load(source + i, mask=inside, other=_LAST)
        run = first // width
        other = (run ^ 1) * width
        # Bisection: how many entries of the other run, low..high, are smaller.
        low = tl.minimum(tl.zeros_like(i) + other, count)
        high = tl.minimum(low + width, count)
        begin = low
        step = width
        while step > 0:
            middle = (low + high) // 2
            searching = low < high
            smaller = searching & (tl.load(source + middle, mask=searching, other=_LAST) < key)
            high = tl.where(searching & (smaller == 0), middle, high)
            low = tl.where(smaller, middle + 1, low)
            step = step // 2
        place = tl.minimum(run, run ^ 1) * width + (i - run * width) + (low - begin)
        tl.store(target + place, key, mask=inside)
