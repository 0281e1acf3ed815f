"""Parquet joined of parts: the bytes of one writer, without anything decoded."""

import numpy as np
import pytest

from balloon_warp.outputs import table_parquet

arrow = pytest.importorskip("pyarrow", reason="needs the extra `data`")
parquet = pytest.importorskip("pyarrow.parquet")

FRAMES, WORLDS = 40, 300
COLUMNS = ("world", "frame", "time", "mesh", "mass", "height", "health")
VARIED = {"mesh": np.array([f"mesh {world % 7}" for world in range(WORLDS)]), "mass": np.linspace(0.1, 0.2, WORLDS)}


def test_row_groups_that_are_encoded_side_by_side_are_those_of_one_writer(tmp_path, monkeypatch):
    """Twenty row groups, which is a long list in Thrift, have the bytes that Arrow itself writes in turn."""
    monkeypatch.setattr(table_parquet, "ROWS", 2 * WORLDS)
    heights = np.random.default_rng(0).normal(size=(FRAMES, 1, WORLDS)).astype(np.float32)
    health = np.ones(WORLDS, dtype=np.int32)
    rows = table_parquet.ParquetRows(tmp_path / "parts.parquet", COLUMNS, VARIED, WORLDS)
    for frame in range(FRAMES):
        rows.write(frame, frame / 60.0, heights[frame], health)
    rows.close()
    found = parquet.ParquetFile(tmp_path / "parts.parquet")
    assert found.num_row_groups == FRAMES // 2
    together = found.read()
    np.testing.assert_array_equal(together["height"].to_numpy(), heights.ravel())
    assert together["mesh"].to_pylist() == FRAMES * VARIED["mesh"].tolist()
    options = {"compression": "zstd", "compression_level": 1}
    options["use_dictionary"] = [name for name in COLUMNS if name != "height"]
    with parquet.ParquetWriter(tmp_path / "whole.parquet", found.schema_arrow, **options) as writer:
        for frame in range(0, FRAMES, 2):
            writer.write_table(together.slice(frame * WORLDS, 2 * WORLDS), row_group_size=2**31 - 1)
    assert (tmp_path / "parts.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()
