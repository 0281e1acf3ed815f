"""Decimal texts of many numbers at once, the same as one by one."""

from pathlib import Path

import numpy as np
import pytest
from batches import assert_text_has_the_numbers_of
from numpy.typing import NDArray

from balloon_warp.outputs import table_csv
from balloon_warp.outputs.decimals import PAD, decimals
from balloon_warp.outputs.table import TableWriter

POWERS = np.array([float(f"1e{exponent}") for exponent in range(-45, 39)], dtype=np.float32)
NEXT_TO_POWERS = np.concatenate([(POWERS.view(np.int32) + step).clip(0).view(np.float32) for step in range(-3, 4)])
RANDOM = np.random.default_rng(0)


@pytest.mark.full
@pytest.mark.parametrize(
    "values",
    [
        pytest.param(RANDOM.integers(0, 2**32, 100_000, dtype=np.uint32).view(np.float32), id="any"),
        pytest.param(np.concatenate([NEXT_TO_POWERS, -NEXT_TO_POWERS]), id="at powers of ten"),
        pytest.param(
            (RANDOM.integers(-(2**24), 2**24, 100_000) / 2.0 ** RANDOM.integers(0, 30, 100_000)).astype(np.float32),
            id="halves of the last digit",
        ),
        pytest.param(np.array([0.0, -0.0, 1.0, 120.0, 0.5, np.inf, -np.inf, np.nan, 1e-45], np.float32), id="special"),
        pytest.param(np.zeros(0, np.float32), id="none"),
    ],
)
def test_the_text_is_that_of_nine_digits(values: NDArray[np.float32]):
    texts = [row[row != PAD].tobytes() for row in decimals(values)]
    assert texts == [b"%.9g" % value for value in values.tolist()]


def test_columns_keep_their_shape():
    values = RANDOM.normal(size=(3, 5)).astype(np.float32)
    rows = decimals(values.T)
    assert rows.shape[:2] == (5, 3)
    assert float(rows[4, 1][rows[4, 1] != PAD].tobytes()) == pytest.approx(values[1, 4], rel=1e-8)


def test_a_table_of_many_worlds_is_that_of_its_numbers(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The table of text holds the numbers of the binary one, whatever the block of worlds and the varied values."""
    monkeypatch.setattr(table_csv, "BLOCK", 3)
    varied = {"balloon.mass": RANDOM.normal(size=11), "balloon.mesh": np.array(['a,"ü".obj'] * 11)}
    with TableWriter(tmp_path, 2, 3.0, varied, ["volume", "area"], 11) as writer:
        writer.values[:] = RANDOM.lognormal(0.0, 9.0, (2, 2, 11))
        writer.health[:] = RANDOM.integers(0, 3, (2, 11))
        for _ in range(2):
            writer.write_frame()
    assert_text_has_the_numbers_of(tmp_path / "table.npz")
