"""Summary of a batch, a row for each world; and the manifest's description of the columns of both tables."""

import csv
import json
from pathlib import Path

import numpy as np
import pytest
from meshes import quad_sphere

from balloon_warp import Balloon, Box, Inflation, Scene, Sphere, run_batch
from balloon_warp.sweep.columns import describe_columns
from balloon_warp.sweep.recorder import columns_of

FRAMES, WORLDS = 8, 4
VARY = {
    "balloon.mass": [0.1, 0.2, 0.1, 0.3],
    "balloon.inflation.k_normal": [0.2, 0.4, 9e11, 0.2],
    "balloon.position.1": [0.0, 1.0, 2.0, 3.0],
}
"""of which one blows up, and all fall"""


def scene(**fields) -> Scene:
    balloon = Balloon(mesh=quad_sphere(2, 0.1), inflation=Inflation(k_normal=0.2))
    fields = {"balloon": [balloon], "frames": FRAMES, "frames_per_second": 8.0, "substeps": 60} | fields
    return Scene(sphere=[Sphere(position=(0, 9, 0))], **fields)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    summary = run_batch(scene(), folder, WORLDS, VARY, export=[0, 2, 3], device="cpu")
    assert [Path(path).name for path in summary.worlds_table] == ["worlds.npz", "worlds.csv"]
    return folder


@pytest.fixture(scope="module")
def tables(written: Path) -> dict[str, dict[str, np.ndarray]]:
    return {name: dict(np.load(written / f"{name}.npz")) for name in ("table", "worlds")}


@pytest.mark.full
def test_each_world_has_a_row_of_ends_and_extremes(tables: dict[str, dict[str, np.ndarray]]):
    table, worlds = tables["table"], tables["worlds"]
    measures = columns_of(scene())
    assert list(worlds) == [
        *("world", *VARY, "health", "ending", "last_frame"),
        *(f"{name}_{end}" for name in measures for end in ("end", "min", "max")),
    ]
    assert worlds["world"].tolist() == [0, 1, 2, 3]
    for path, values in VARY.items():
        np.testing.assert_array_equal(worlds[path], values)
    for name in measures:
        of_frames = table[name].reshape(FRAMES + 1, WORLDS)
        for end, expected in {"end": of_frames[-1], "min": of_frames.min(0), "max": of_frames.max(0)}.items():
            np.testing.assert_array_equal(worlds[f"{name}_{end}"], expected)
    assert (worlds["center_height_max"] > worlds["center_height_end"] + 1.0)[[0, 1, 3]].all()


def test_it_says_how_each_world_ended(tables: dict[str, dict[str, np.ndarray]]):
    """The summary has each world's outcome: falling forever is detected in worlds of the stage."""
    worlds = tables["worlds"]
    assert worlds["health"].tolist() == [1, 1, 0, 1]
    assert worlds["ending"].tolist() == ["falling", "finished", "blew up", "falling"]
    assert worlds["last_frame"].tolist() == [FRAMES, FRAMES, 0, FRAMES]


def test_the_text_has_the_same_numbers(written: Path, tables: dict[str, dict[str, np.ndarray]]):
    with (written / "worlds.csv").open(newline="") as file:
        header, *rows = csv.reader(file)
    assert header == list(tables["worlds"])
    for (name, column), texts in zip(tables["worlds"].items(), zip(*rows, strict=True), strict=True):
        np.testing.assert_array_equal(np.array(texts).astype(column.dtype), column, err_msg=name)


def test_the_manifest_has_units_of_all_columns(written: Path, tables: dict[str, dict[str, np.ndarray]]):
    columns = json.loads((written / "manifest.json").read_text())["columns"]
    assert set(columns) == {*tables["table"], *tables["worlds"]}
    units = {name: column["unit"] for name, column in columns.items()}
    assert units["time"] == "s"
    assert (units["volume"], units["volume_max"], units["sphere_0_height_min"]) == ("m^3", "m^3", "m")
    assert (units["balloon.mass"], units["balloon.position.1"]) == ("kg", "m")
    assert columns["balloon.mass"]["meaning"].startswith("Mass of the whole balloon")
    assert all(column["meaning"] for column in columns.values())


def test_every_column_that_there_may_be_has_a_unit():
    """Every possible column has a unit: of gas, of bursting, of a box; and of values that change a world's model."""
    gas = Balloon(mesh=quad_sphere(2), inflation=Inflation(pump=[(0, 0), (1, 0.1)]))
    vary = ("balloon.mesh", "balloon.scale", "balloon.stiffness.seed", "balloon.inflation.pump", "atmosphere.wind.0")
    told = describe_columns(scene(balloon=[gas], box=Box(lower=(0, 0, 0), upper=(1, 1, 1))), vary)
    assert all(column["meaning"] for column in told.values())
    units = {name: column["unit"] for name, column in told.items()}
    assert {name: units[name] for name in (*vary, "moles_end", "thrust_max", "in_box")} == {
        **{"balloon.mesh": "", "balloon.scale": "1", "balloon.stiffness.seed": "1", "balloon.inflation.pump": "mol/s"},
        **{"atmosphere.wind.0": "m/s", "moles_end": "mol", "thrust_max": "N", "in_box": "1"},
    }
