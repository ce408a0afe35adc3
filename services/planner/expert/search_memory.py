"""Working memory of searches over poses: nodes, a heap of those that wait, a table of the best node per key.

The heap is binary: the children of entry k are 2 k + 1 and 2 k + 2, and no child costs less than its parent. A node
that a better one of its key has replaced stays in the heap; searches skip it when it comes to the top.
"""

from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array, Int32Array, Int64Array
from readygo.common.kernels import kernel_with_cache

X, Y, YAW, COST = 0, 1, 2, 3
"""Places in a node."""
PARENT, PRIMITIVE = 0, 1
"""Places in its links; the root's parent is -1."""
_HASH = -7046029254386353131
"""2^64 over the golden ratio, as a signed number."""
_HASH_SHIFT = 29
"""Brings the upper bits of the product, the better mixed ones, down to those that number the slots."""


class Memory(NamedTuple):
    """The memory of one search, for compiled functions."""

    nodes: Float64Array
    """x [m], y [m], yaw [rad], cost, shape (N, 4)."""
    links: Int32Array
    """Parent, primitive, and what else the search notes, shape (N, L)."""
    heap_costs: Float64Array
    """Cost and node of those that wait, cheapest on top, shape (N,)."""
    heap_nodes: Int32Array
    table_keys: Int64Array
    """Key and best node of each slot, shape (S,)."""
    table_nodes: Int32Array
    table_stamps: Int32Array
    """The search that wrote each slot, shape (S,)."""
    stamp: int
    """Number of the present search."""


class SearchMemory:
    """Kept between searches, so it is not thread-safe; a stamp tells a search's table entries from older ones."""

    def __init__(self, node_max: int, link_count: int, table_size: int) -> None:
        """Make room.

        Args:
            node_max: Nodes of one search.
            link_count: Numbers that a node has besides its pose and cost.
            table_size: Slots of the table, a power of two above `node_max`.
        """
        self._memory = Memory(
            nodes=np.empty((node_max, 4)),
            links=np.empty((node_max, link_count), np.int32),
            heap_costs=np.empty(node_max),
            heap_nodes=np.empty(node_max, np.int32),
            table_keys=np.empty(table_size, np.int64),
            table_nodes=np.empty(table_size, np.int32),
            table_stamps=np.zeros(table_size, np.int32),
            stamp=0,
        )

    def begin(self) -> Memory:
        """The memory of a new search; it overwrites that of the one before."""
        self._memory = self._memory._replace(stamp=self._memory.stamp + 1)
        return self._memory


@kernel_with_cache
def push(costs: Float64Array, nodes: Int32Array, count: int, cost: float, node: int) -> int:
    """Put an entry into a heap of `count` entries; returns their new number."""
    # Dearer parents move down until the entry's place is found.
    k = count
    while k > 0:
        parent = (k - 1) >> 1
        if costs[parent] <= cost:
            break
        costs[k], nodes[k] = costs[parent], nodes[parent]
        k = parent
    costs[k], nodes[k] = cost, node
    return count + 1


@kernel_with_cache
def pop(costs: Float64Array, nodes: Int32Array, count: int) -> int:
    """Remove the cheapest entry, which the caller has read from the top."""
    count -= 1
    # The last entry fills the hole at the top: cheaper children move up until its place is found.
    cost, node = costs[count], nodes[count]
    k = 0
    while True:
        child = 2 * k + 1
        if child >= count:
            break
        if child + 1 < count and costs[child + 1] < costs[child]:
            child += 1
        if costs[child] >= cost:
            break
        costs[k], nodes[k] = costs[child], nodes[child]
        k = child
    costs[k], nodes[k] = cost, node
    return count


@kernel_with_cache
def slot_of(key: int, stamp: int, table_keys: Int64Array, table_stamps: Int32Array) -> int:
    """Table slot of a key: where it is, or where it would be put (open addressing, Fibonacci hashing)."""
    mask = len(table_keys) - 1
    mixed = key * _HASH
    slot = (mixed ^ (mixed >> _HASH_SHIFT)) & mask
    # Slots that other searches wrote count as empty.
    while table_stamps[slot] == stamp and table_keys[slot] != key:
        slot = (slot + 1) & mask
    return slot
