"""Memoized searches."""

import numpy as np
import pytest
from numpy.typing import NDArray

from balloon_warp.schedules import memoize as module
from balloon_warp.schedules.memoize import memoized


def test_what_was_found_is_not_sought_again():
    sought: list[list[int]] = []

    @memoized
    def doubled(values: NDArray[np.int64]) -> NDArray[np.int64]:
        sought.append(values.tolist())
        return 2 * values

    first, other = np.arange(4), np.arange(4).reshape(2, 2)
    assert doubled(first).tolist() == doubled(first.copy()).tolist() == [0, 2, 4, 6]
    assert doubled(other).tolist() == [[0, 2], [4, 6]]
    first[0] = 5
    assert doubled(first).tolist() == [10, 2, 4, 6]
    assert sought == [[0, 1, 2, 3], [[0, 1], [2, 3]], [5, 1, 2, 3]]


def test_an_answer_cannot_be_spoiled():
    answer = memoized(lambda values: values)(given := np.arange(3))
    given[0] = 7
    assert answer.tolist() == [0, 1, 2]
    with pytest.raises(ValueError, match="read-only"):
        answer[0] = 1


def test_only_the_last_answers_are_kept(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(module, "LAST", 2)
    sought: list[int] = []

    @memoized
    def same(values: NDArray[np.int64]) -> NDArray[np.int64]:
        sought.append(int(values[0]))
        return values

    for number in (0, 1, 0, 2, 0, 1):
        same(np.array([number]))
    assert sought == [0, 1, 2, 1]
