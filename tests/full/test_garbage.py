"""Garbage collection, paused while many lasting objects are made."""

import gc
from collections.abc import Iterator

import pytest

from balloon_warp.system.loading import without_collecting


@pytest.fixture(autouse=True)
def as_it_was() -> Iterator[None]:
    gc.unfreeze()
    gc.collect()
    yield
    gc.unfreeze()
    gc.enable()


def test_it_is_put_off_and_then_goes_on():
    with without_collecting():
        assert not gc.isenabled()
        with without_collecting():
            pass
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_freeze_count() == 0


def test_what_was_made_meanwhile_is_old():
    with without_collecting():
        made = [[] for _ in range(2 * gc.get_threshold()[0])]
    young = {id(each) for generation in (0, 1) for each in gc.get_objects(generation)}
    assert not young & {id(each) for each in made}


def test_what_someone_else_chose_stays():
    gc.freeze()
    frozen = gc.get_freeze_count()
    with without_collecting():
        pass
    assert gc.get_freeze_count() == frozen
    gc.disable()
    with without_collecting():
        pass
    assert not gc.isenabled()
