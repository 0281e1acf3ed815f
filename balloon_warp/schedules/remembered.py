"""Searches that take long and are asked the same thing again: by the next share of a batch, say, of the same meshes."""

import hashlib
from collections import OrderedDict
from collections.abc import Callable
from functools import wraps
from typing import Concatenate

import numpy as np
from numpy.typing import NDArray

Search = Callable[Concatenate[NDArray[np.int64], ...], NDArray[np.int64]]

LAST = 8
"""answers that are remembered of a search"""


def remembered(search: Search) -> Search:
    """The same search of arrays, which knows its last answers; nobody can write into them."""
    answers: OrderedDict[str, NDArray[np.int64]] = OrderedDict()

    @wraps(search)
    def remembering(*asked: NDArray[np.int64]) -> NDArray[np.int64]:
        key = hashlib.sha256()
        for array in asked:
            key.update(f"{array.shape} {array.dtype}".encode())
            key.update(np.ascontiguousarray(array).data)
        answer = answers.pop(key.hexdigest(), None)
        if answer is None:
            answer = search(*asked).copy()
            answer.setflags(write=False)
        answers[key.hexdigest()] = answer
        while len(answers) > LAST:
            answers.popitem(last=False)
        return answer

    return remembering
