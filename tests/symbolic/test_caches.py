"""Objects that are built for machines are bounded in memory."""

import pytest

from orbits import find
from orbits.symbolic import caches
from problems import Hopper


@pytest.mark.slow
def test_what_is_kept_is_let_go_of_when_it_grows(monkeypatch):
    monkeypatch.setattr(caches, "CACHE", caches.CACHE._replace(bytes=3e6))
    most = 0.0
    for k in range(6):
        find(Hopper(f"r + 0.1{k}*r**3"))
        most = max(most, caches._built)
    assert 0.5e6 < most <= 3e6
    assert find(Hopper("r + 0.3*r**3")).alpha == find(Hopper("r + 0.3*r**3")).alpha


def test_the_least_recently_used_is_forgotten(monkeypatch):
    monkeypatch.setattr(caches, "_cached", {})
    monkeypatch.setattr(caches, "_built", 0.0)
    built = []
    build = caches.cached(lambda k: built.append(k) or k)
    for k in (1, 2, 3, 4, 1):
        assert build(k) == k
    caches.weigh([], int(caches.CACHE.bytes) + 1)
    assert [build(k) for k in (4, 1, 2)] == [4, 1, 2]
    assert built == [1, 2, 3, 4, 2]
    monkeypatch.setattr(caches, "CACHE", caches.CACHE._replace(results=4))
    assert [build(k) for k in (5, 6, 2)] == [5, 6, 2]
    assert built == [1, 2, 3, 4, 2, 5, 6]
    assert len(caches._cached) <= 4
