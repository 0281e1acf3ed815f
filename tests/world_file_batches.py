"""Helpers of the tests of files of worlds."""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from numpy.typing import NDArray
from stopped_batch import scene

from balloon_warp import TrajectoryFiles, run_batch

WORLDS = 5
VARY = {"balloon.mass": np.linspace(1.0, 2.0, WORLDS), "gravity": np.linspace(1.0, 9.0, WORLDS)}
BLOWS_UP = {"balloon.inflation.k_normal": [0.2, 9e11, 0.4, 0.5, 0.3]}
"""world 1 does"""


def batch(folder: Path, format_: str = "h5", vary: dict[str, Any] = VARY, every: int = 1, **how: Any) -> Path:
    """Run a small batch and return the folder of its trajectories."""
    files = TrajectoryFiles(folder / "data", every, format_)
    run_batch(scene(contacts=True), folder / "out", WORLDS, vary, device="cpu", trajectories=files, **how)
    return folder / "data"


def manifest(data: Path) -> dict[str, Any]:
    return json.loads((data / "manifest.json").read_text())


def files_of(data: Path) -> dict[str, bytes]:
    """Return the bytes of files, of folders those of the files in them."""
    return {str(path.relative_to(data)): path.read_bytes() for path in sorted(data.rglob("*")) if path.is_file()}


def world_file(data: Path, world: int) -> Path:
    return next(data.glob(f"*/world_{world:06d}.*"))


def arrays_of(path: Path) -> dict[str, NDArray]:
    """Return the arrays as a reader without our package does."""
    if path.suffix == ".npz":
        with np.load(path) as saved:
            return {name: saved[name] for name in saved if name != "attributes"}
    if path.suffix == ".zarr":
        group = pytest.importorskip("zarr").open_group(path, mode="r")
        return {name: array[:] for name, array in group.arrays()}
    with h5py.File(path) as file:
        return {name: data[:] for name, data in file.items()}


def attributes_of(path: Path) -> dict[str, Any]:
    if path.suffix == ".npz":
        with np.load(path) as saved:
            return json.loads(str(saved["attributes"]))
    if path.suffix == ".zarr":
        return json.loads((path / ".zattrs").read_text())
    with h5py.File(path) as file:
        return dict(file.attrs)
