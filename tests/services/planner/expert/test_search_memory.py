import numpy as np

from readygo.services.planner.expert.search_memory import SearchMemory, pop, push, slot_of


def test_heap_gives_the_cheapest_first():
    rng = np.random.default_rng(0)
    costs, nodes, count = np.empty(200), np.empty(200, np.int32), 0
    wanted = rng.uniform(size=200)
    for node, cost in enumerate(wanted):
        count = push(costs, nodes, count, cost, node)
    found = []
    while count > 0:
        found.append(int(nodes[0]))
        count = pop(costs, nodes, count)
    assert found == np.argsort(wanted).tolist()


def test_keys_have_slots_of_their_own_and_a_new_search_finds_them_empty():
    memory = SearchMemory(16, 2, 64).begin()
    for node, key in enumerate(range(0, 48 * 4096, 4096)):
        slot = slot_of(key, memory.stamp, memory.table_keys, memory.table_stamps)
        assert memory.table_stamps[slot] != memory.stamp
        memory.table_stamps[slot], memory.table_keys[slot], memory.table_nodes[slot] = memory.stamp, key, node
    for node, key in enumerate(range(0, 48 * 4096, 4096)):
        slot = slot_of(key, memory.stamp, memory.table_keys, memory.table_stamps)
        assert memory.table_nodes[slot] == node


def test_searches_have_stamps_of_their_own_on_the_same_memory():
    search = SearchMemory(16, 2, 64)
    first, second = search.begin(), search.begin()
    assert second.stamp == first.stamp + 1 > 0
    assert second.nodes is first.nodes
