"""Splits of a batch's worlds: which are for training, for validation, and for test."""

import numpy as np
from numpy.typing import NDArray

SPLITS = ("train", "validation", "test")
OF_TEN = (8, 1, 1)
"""Number of each ten worlds that go to each split"""


def splits_of(world_count: int, seed: int) -> NDArray[np.int64]:
    """Draw the split of each world, a number of `SPLITS`, shape (world_count,).

    Each ten worlds in a row have eight for training, one for validation and one for test. The split of a world depends
    on the seed and its number alone, so that a larger batch keeps it.
    """
    ten = np.repeat(np.arange(len(SPLITS)), OF_TEN)
    tens = [np.random.default_rng([seed, number]).permutation(ten) for number in range(-(-world_count // len(ten)))]
    return np.concatenate([np.zeros(0, dtype=np.int64), *tens])[:world_count]
