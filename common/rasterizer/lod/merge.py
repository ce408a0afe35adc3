"""Merging of the clusters of regions, pair by pair, cheapest first."""

import numpy as np

from readygo.common.arrays import Float64Array, Int32Array, Int64Array
from readygo.common.kernels import inline_kernel, kernel
from readygo.common.rasterizer.lod.clusters import NEIGHBOURS, Clusters, Originals, gather
from readygo.common.rasterizer.lod.cost import MergeRule, find_unrest, merger_cost

LONGEST_WAIT = 8
"""Calls after which a cluster is looked at again at the latest."""
_NEW, _TAKEN = -1, -2
"""What `c.number` says while pairs are chosen: not in a pair, and the first one of a pair."""


@inline_kernel
def _find_neighbours(count: int, wait: Int64Array, c: Clusters) -> None:
    """The nearest clusters of each that does not wait, and of these in turn; the others have none."""
    for k in range(count):
        for axis in range(3):
            c.place_m[axis, k] = c.mean_m[k, axis]
        for n in range(NEIGHBOURS):
            c.distance2[k, n] = np.inf
            c.near[k, n] = -1
    for k in range(count):
        if wait[k] <= 0:
            _find_nearest(k, count, c)
    for k in range(count):
        if wait[k] > 0:
            continue
        for n in range(NEIGHBOURS):
            other = c.near[k, n]
            if other >= 0 and c.near[other, 0] < 0:
                _find_nearest(other, count, c)


@inline_kernel
def _find_nearest(k: int, count: int, c: Clusters) -> None:
    """The nearest clusters of cluster `k`, of equally near ones those of smaller numbers."""
    _find_distances(k, count, c)
    # Clusters of neighbouring numbers are near: those behind `k` come first, so that few fall out again.
    for other in range(k + 1, count):
        if c.row[other] < c.distance2[k, NEIGHBOURS - 1]:
            _insert(c, k, other, c.row[other])
    for other in range(k - 1, -1, -1):
        if c.row[other] <= c.distance2[k, NEIGHBOURS - 1]:
            _insert(c, k, other, c.row[other])


@inline_kernel
def _find_distances(k: int, count: int, c: Clusters) -> None:
    """Squared distances of all clusters to cluster `k`."""
    xs, ys, zs, row = c.place_m[0], c.place_m[1], c.place_m[2], c.row
    x, y, z = xs[k], ys[k], zs[k]
    for other in range(count):
        dx, dy, dz = x - xs[other], y - ys[other], z - zs[other]
        row[other] = dx * dx + dy * dy + dz * dz


@inline_kernel
def _insert(c: Clusters, k: int, other: int, distance2: float) -> None:
    """Put a neighbour into the list of cluster `k`, sorted by distance, then by number; the last one falls out."""
    place = NEIGHBOURS - 1
    while place > 0 and (
        c.distance2[k, place - 1] > distance2
        or (c.distance2[k, place - 1] == distance2 and c.near[k, place - 1] > other)
    ):
        c.distance2[k, place] = c.distance2[k, place - 1]
        c.near[k, place] = c.near[k, place - 1]
        place -= 1
    c.distance2[k, place] = distance2
    c.near[k, place] = other


@inline_kernel
def _same_skin(i: int, j: int, tolerance: float, c: Clusters) -> bool:
    """True if the joint weights of two clusters differ by at most the tolerance, summed over the joints."""
    total = 0.0
    for joint in range(c.skin.shape[1]):
        total += abs(c.skin[i, joint] - c.skin[j, joint])
    return total <= tolerance


@inline_kernel
def _find_partners(count: int, rule: MergeRule, wait: Int64Array, c: Clusters) -> None:
    """The cheapest merger with a neighbour of each cluster that does not wait."""
    for k in range(count):
        c.cost[k] = np.inf
        c.partner[k] = -1
    for k in range(count):
        if wait[k] > 0:
            continue
        for n in range(NEIGHBOURS):
            other = c.near[k, n]
            if other < 0:
                break
            if not _same_skin(k, other, rule.skin_tolerance, c):
                continue
            cost = merger_cost(k, n, max(c.cost[k], c.cost[other]), rule, c)
            if cost < c.cost[k]:
                c.cost[k], c.partner[k] = cost, other
            if cost < c.cost[other]:
                c.cost[other], c.partner[other] = cost, k


@inline_kernel
def _all_wait(count: int, wait: Int64Array) -> bool:
    """True if no cluster of a region is to be looked at."""
    waiting = 0
    for k in range(count):
        waiting += 1 if wait[k] > 0 else 0
    return waiting == count


@inline_kernel
def _set_waits(count: int, tolerance: float, wait: Int64Array, c: Clusters) -> None:
    """Clusters whose cheapest merger is far too expensive wait: from level to level a cost falls to a quarter at most.

    (So it does where the overlaps of dilated points decide, with the fourth power of the pixel's size.)
    """
    for k in range(count):
        if wait[k] > 0 or c.cost[k] <= tolerance:
            continue
        wait[k] = 1
        cost = 0.25 * c.cost[k]
        while cost > tolerance and wait[k] < LONGEST_WAIT:
            wait[k] += 1
            cost *= 0.25


@inline_kernel
def _pair_up(count: int, tolerance: float, c: Clusters) -> int:
    """Merge pairs, cheapest first, each cluster once: new numbers in `c.number`, the new count back."""
    c.number[:count] = _NEW
    while True:
        best, best_cost = -1, np.inf
        for k in range(count):
            if c.cost[k] < best_cost:
                best, best_cost = k, c.cost[k]
        if best_cost > tolerance:
            break
        other = c.partner[best]
        c.cost[best] = np.inf
        if c.number[best] == _NEW and c.number[other] == _NEW:
            # The later one of the pair refers to the earlier one, which keeps its turn below.
            c.number[max(best, other)] = min(best, other)
            c.number[min(best, other)] = _TAKEN
            c.cost[other] = np.inf
    fresh = 0
    for k in range(count):
        if c.number[k] >= 0:
            c.number[k] = c.number[c.number[k]]
        else:
            c.number[k] = fresh
            fresh += 1
    return fresh


@inline_kernel
def _renumber(count: int, wait: Int64Array, c: Clusters) -> None:
    """Move the waits to the new numbers; merged clusters do not wait."""
    fresh = 0
    for k in range(count):
        if c.number[k] == fresh:
            wait[fresh] = wait[k]
            fresh += 1
        else:
            wait[c.number[k]] = 0


@kernel
def merge_regions(
    originals: Originals,
    label: Int32Array,
    first: Int64Array,
    count: Int64Array,
    wait: Int64Array,
    leeway: Float64Array,
    rule: MergeRule,
    rounds: int,
    c: Clusters,
) -> None:
    """Merge clusters within each region until the cheapest merger costs more than the tolerance.

    Args:
        originals: Gaussians.
        label: Cluster of each Gaussian within its region; changed, shape (N,).
        first: First Gaussian of each region, and the end, shape (R + 1,).
        count: Clusters of each region; changed, shape (R,).
        wait: For how many calls a region's clusters need not be looked at, from its first Gaussian's place on, one per
            cluster; changed, shape (N,).
        leeway: Factors of the tolerance, shape (R,).
        rule: What may be merged.
        rounds: Each merges a cluster at most once.
        c: Scratch memory.
    """
    for region in range(len(count)):
        begin, end = first[region], first[region + 1]
        tolerance = rule.tolerance * leeway[region]
        waits = wait[begin:end]
        for k in range(count[region]):
            waits[k] = max(waits[k] - 1, 0)
        for _ in range(rounds):
            before = count[region]
            if _all_wait(before, waits):
                break
            gather(originals, label, begin, end, before, rule.pixel_m, c)
            _find_neighbours(before, waits, c)
            find_unrest(before, rule, c)
            _find_partners(before, rule, waits, c)
            _set_waits(before, tolerance, waits, c)
            after = _pair_up(before, tolerance, c)
            if after == before:
                break
            _renumber(before, waits, c)
            for i in range(begin, end):
                label[i] = c.number[label[i]]
            count[region] = after
