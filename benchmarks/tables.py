"""Speed of writing a batch's table, as text and as Parquet: `python -m balloon_warp.benchmarks.tables 16384 120`."""

import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from balloon_warp.batch.recorder import MEASURES
from balloon_warp.batch.table import KINDS, Columns, TableWriter, table_names


def seconds_of(kind: str, world_count: int, frames: int, folder: Path) -> float:
    """Time to write the frames, without the .npz that both have [s]."""
    varied = {"balloon.helium": np.random.default_rng(0).uniform(8.0, 16.0, world_count)}
    writer = TableWriter(folder, frames + 1, 60.0, Columns(varied, MEASURES), world_count, kind)
    writer.values[:] = np.random.default_rng(1).normal(size=writer.values.shape)
    writer.health[:] = 1
    rows = KINDS[kind](folder / table_names(kind)[1], writer.columns.names, varied, world_count)
    begin = time.perf_counter()
    for frame in range(frames + 1):
        rows.write(frame, frame / 60.0, writer.values[frame], writer.health[frame])
    rows.close()
    return time.perf_counter() - begin


def main() -> None:
    """Print a line for each kind."""
    world_count, frames = (int(word) for word in sys.argv[1:3]) if len(sys.argv) > 2 else (16384, 120)
    rows = world_count * (frames + 1)
    for kind in KINDS:
        with tempfile.TemporaryDirectory() as name:
            seconds = seconds_of(kind, world_count, frames, Path(name))
            size = (Path(name) / table_names(kind)[1]).stat().st_size
        print(f"{kind}: {rows:,} rows in {seconds:.2f} s, {rows / seconds:,.0f} rows a second, {size / 1e6:.0f} MB")


if __name__ == "__main__":
    main()
