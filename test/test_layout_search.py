"""The layout search is exact: it equals looking at every layout."""

from __future__ import annotations

import numpy as np
import pytest
from naive_layout_search import naive_energies

from room_layout_ros.core.integral_geometry import PairTables
from room_layout_ros.core.layout_search import (
    add_unaries,
    diverse_layouts,
    layout_energy,
    min_marginals,
    search_layout,
)


def random_tables(rng: np.random.Generator, sizes: tuple[int, int, int, int] = (5, 4, 6, 3)) -> PairTables:
    a, b, c, d = sizes
    return rng.normal(size=(a, c)), rng.normal(size=(a, d)), rng.normal(size=(b, c)), rng.normal(size=(b, d))


@pytest.fixture(params=((5, 4, 6, 3), (1, 7, 7, 1), (1, 1, 1, 1), (8, 2, 1, 9)), ids=str)
def tables(request: pytest.FixtureRequest, rng: np.random.Generator) -> PairTables:
    return random_tables(rng, request.param)


def test_search_finds_the_minimum_of_all_layouts(tables: PairTables) -> None:
    energies = naive_energies(tables)
    found = search_layout(tables)
    assert found.energy == pytest.approx(min(energies.values()), abs=1e-12)
    assert energies[found.layout] == pytest.approx(found.energy, abs=1e-12)


def test_search_finds_the_minimum_in_two_hundred_random_cycles(rng: np.random.Generator) -> None:
    for _ in range(200):
        tables = random_tables(rng, (4, 3, 4, 5))
        assert search_layout(tables).energy == pytest.approx(min(naive_energies(tables).values()), abs=1e-12)


def test_min_marginals_are_the_minima_over_the_other_rays(tables: PairTables) -> None:
    energies = naive_energies(tables)
    for side, marginal in enumerate(min_marginals(tables)):
        truth = [min(e for y, e in energies.items() if y[side] == state) for state in range(len(marginal))]
        np.testing.assert_allclose(marginal, truth, atol=1e-12)


def test_unaries_count_once_each(rng: np.random.Generator) -> None:
    tables = random_tables(rng)
    unaries = rng.normal(size=5), rng.normal(size=4), rng.normal(size=6), rng.normal(size=3)
    for layout, energy in naive_energies(tables).items():
        expected = energy + sum(u[s] for u, s in zip(unaries, layout, strict=True))
        assert layout_energy(add_unaries(tables, unaries), layout) == pytest.approx(expected, abs=1e-12)


def test_diverse_layouts_are_ordered_apart_and_begin_with_the_best(rng: np.random.Generator) -> None:
    tables = random_tables(rng, (20, 20, 20, 20))
    found = diverse_layouts(tables, 5, distance=3)
    assert len(found) == 5
    assert found[0] == search_layout(tables)
    assert [r.energy for r in found] == sorted(r.energy for r in found)
    for i, a in enumerate(found):
        assert a.energy == pytest.approx(layout_energy(tables, a.layout))
        for b in found[:i]:
            assert max(abs(s - t) for s, t in zip(a.layout, b.layout, strict=True)) > 3


def test_diverse_layouts_of_a_single_layout_are_one(rng: np.random.Generator) -> None:
    assert len(diverse_layouts(random_tables(rng, (1, 1, 1, 1)), 4)) == 1


def test_same_input_gives_the_same_layout_where_all_are_equal() -> None:
    tables = tuple(np.zeros((3, 3)) for _ in range(4))
    assert search_layout(tables).layout == (0, 0, 0, 0)  # type: ignore[arg-type]
