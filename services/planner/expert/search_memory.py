"""Working memory of searches over poses: nodes, a heap of those that wait, a table of the best node per key."""

import numpy as np
import numpy.typing as npt

from readygo.common.kernels import compiled

Float64Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]
Memory = tuple[Float64Array, Int32Array, Float64Array, Int32Array]
"""`SearchMemory.nodes` and `links`; costs and nodes of the heap."""
Table = tuple[npt.NDArray[np.int64], Int32Array, Int32Array]
"""Keys, nodes, and the stamp of the search that wrote each slot."""


class SearchMemory:
    """Kept between searches, so it is not thread-safe; a stamp tells a search's table entries from older ones."""

    def __init__(self, node_max: int, link_count: int, table_size: int) -> None:
        """Make room.

        Args:
            node_max: Nodes of one search.
            link_count: Numbers that a node has besides its pose and cost.
            table_size: Slots of the table, a power of two above `node_max`.
        """
        self.nodes = np.empty((node_max, 4))
        """x [m], y [m], yaw [rad], cost, shape (N, 4)."""
        self.links = np.empty((node_max, link_count), np.int32)
        """Parent, primitive, and what else the search notes, shape (N, L)."""
        self.memory: Memory = (self.nodes, self.links, np.empty(node_max), np.empty(node_max, np.int32))
        keys, best = np.empty(table_size, np.int64), np.empty(table_size, np.int32)
        self.table: Table = (keys, best, np.zeros(table_size, np.int32))
        self._stamp = 0

    def next_stamp(self) -> int:
        """The stamp of a new search."""
        self._stamp += 1
        return self._stamp


@compiled
def push(costs: Float64Array, nodes: Int32Array, count: int, cost: float, node: int) -> int:
    """Put an entry into a heap of `count` entries; returns their new number."""
    k = count
    while k > 0:
        parent = (k - 1) >> 1
        if costs[parent] <= cost:
            break
        costs[k], nodes[k] = costs[parent], nodes[parent]
        k = parent
    costs[k], nodes[k] = cost, node
    return count + 1


@compiled
def pop(costs: Float64Array, nodes: Int32Array, count: int) -> int:
    """Remove the cheapest entry, which the caller has read from the top."""
    count -= 1
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


@compiled
def slot_of(key: int, stamp: int, table_key: npt.NDArray[np.int64], table_stamp: Int32Array) -> int:
    """Table slot of a key: where it is, or where it would be put (open addressing, Fibonacci hashing)."""
    mask = len(table_key) - 1
    mixed = key * -7046029254386353131
    slot = (mixed ^ (mixed >> 29)) & mask
    while table_stamp[slot] == stamp and table_key[slot] != key:
        slot = (slot + 1) & mask
    return slot
