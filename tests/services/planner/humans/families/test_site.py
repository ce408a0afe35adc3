import gc
import math
import weakref

import numpy as np

from tests.services.planner.worlds import DOORS, planner_of


def test_passages_on_the_way_are_the_doors_it_leads_through():
    sampler, rng = planner_of("doorway").sampler, np.random.default_rng(0)
    found = 0
    for task in (sampler.draw_task(rng) for _ in range(10)):
        for middle, along_m in sampler.site.passages_on_way(task):
            assert min(math.dist(middle, door) for door in DOORS) < 0.6
            assert 0.8 <= along_m <= task.length_m - 0.5
            assert math.dist(task.at(along_m / task.length_m)[0], middle) < 0.6
            found += 1
    assert found > 3


def test_site_keeps_what_it_found_for_the_latest_task_only_and_no_site_outlives_its_planner():
    sampler, rng = planner_of("doorway").sampler, np.random.default_rng(0)
    first, second = sampler.draw_task(rng), sampler.draw_task(rng)
    found = sampler.site.passages_on_way(first)
    assert sampler.site.passages_on_way(first) is found
    sampler.site.passages_on_way(second)
    task, site = weakref.ref(first), weakref.ref(sampler.site)
    del first, sampler
    gc.collect()
    assert task() is None
    assert site() is None
