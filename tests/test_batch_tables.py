"""Tables of a batch: measures, units and kinds; resumed batches, the same byte by byte as uninterrupted ones."""

import itertools
import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pandas as pd
import pytest
from batches import FRAMES as BATCH_FRAMES
from batches import (
    NAMES,
    OFTEN,
    assert_text_has_the_numbers_of,
    contents,
    press_ctrl_c_once,
    scene,
    stop_after,
)
from batches import WORLDS as BATCH_WORLDS
from meshes import cube, open_cube, quad_sphere
from pxr import Usd, UsdGeom
from pyarrow import parquet

from balloon_warp import InputError, MissingExtraError, PolygonMesh, Simulator, run_batch
from balloon_warp.batch import table
from balloon_warp.batch.batch import BatchSummary
from balloon_warp.batch.recorder import Recorder, columns_of, describe_columns
from balloon_warp.batch.task import BatchOutput
from balloon_warp.mesh.obj import write_obj
from balloon_warp.mesh.topology import signed_volume, total_area
from balloon_warp.run.checkpoints import Part
from balloon_warp.scene import Balloon, Box, Inflation, Scene, Sphere, Stiffness
from balloon_warp.system.files import PAD, decimals
from balloon_warp.usd import stage as growing

FLOAT32 = 1.2e-7  # its relative rounding
STILL = {"stiffness": Stiffness(structural=0.0, shear=0.0, flexion=0.0), "inflation": Inflation(k_normal=0.0)}


def recorder_of(simulator: Simulator) -> Recorder:
    return Recorder(simulator, np.array([], dtype=np.int64))


def measured(simulator: Simulator, world: int = 0) -> dict[str, float]:
    row = recorder_of(simulator).read().measures[world]
    return dict(zip(columns_of(simulator.model.scene), row.tolist(), strict=True))


def test_what_is_in_the_box_is_counted(device):
    places = [(0.0, 0.0, 0.0), (0.9, 0.0, 0.0), (0.0, -1.7, 0.0), (0.0, 0.0, 5.0)]
    balloons = [Balloon(mesh=cube(), position=place, **STILL) for place in places]
    box = Box(lower=(-0.2, -1.0, 0.0), upper=(1.5, 1.0, 1.0))
    scene = Scene(balloon=balloons, sphere=[Sphere(position=(0.1, 0.2, 0.3))], box=box, touch=False)
    simulator = Simulator(scene, device, 2, {"balloon.1.position.0": [0.9, 1.2]})
    assert [measured(simulator, world)["in_box"] for world in (0, 1)] == [2.0, 1.0]
    assert "in_box" not in measured(Simulator(scene.model_copy(update={"box": None}), device))


def test_balloons_are_summed_and_their_centers_weighed_by_mass(device):
    large = Balloon(mesh=cube(), mass=3.0, scale=2.0, position=(5.0, 4.0, 0.0), **STILL)
    scene = Scene(balloon=[Balloon(mesh=cube(), mass=1.0, **STILL), large], up_axis="Z")
    up = scene.model_copy(update={"up_axis": "Y"})
    for turned, height in ((up, 0.25 * 0.5 + 0.75 * 5.0), (scene, 0.25 * 0.5 + 0.75 * 1.0)):
        simulator = Simulator(turned, device)
        if turned is scene:  # the meshes are Y-up: laid out as they were, so that only the axis differs
            simulator.state.points.assign(Simulator(up, device).state.points.numpy())
        found = measured(simulator)
        np.testing.assert_allclose([found["volume"], found["area"]], [9.0, 30.0], rtol=4 * FLOAT32)
        np.testing.assert_allclose(found["center_height"], height, rtol=4 * FLOAT32)


def deformed(mesh: PolygonMesh, shift: float) -> PolygonMesh:
    """Return a mesh bent and dented, far from the origin, at places that float32 holds."""
    points = mesh.points * [1.0, 1.4, 0.8] + 0.15 * np.sin(4.0 * mesh.points[:, [1, 2, 0]]) + shift
    return replace(mesh, points=points.astype(np.float32).astype(np.float64))


def test_volume_and_area_are_those_of_the_host_in_float64(device):
    """About the origin the volume at 100 m would be off by some 100^3 times float32's rounding, a tenth."""
    for mesh, shift in itertools.product((quad_sphere(9), open_cube(), quad_sphere(2)), (0.0, 100.0)):
        bent = deformed(mesh, shift)
        found = measured(Simulator(Scene(balloon=[Balloon(mesh=bent, **STILL)]), device))
        np.testing.assert_allclose(found["volume"], signed_volume(bent), rtol=20 * FLOAT32)
        np.testing.assert_allclose(found["area"], total_area(bent), rtol=20 * FLOAT32)
        center = bent.points[bent.face_vertex_indices].mean(axis=0)[1]
        np.testing.assert_allclose(found["center_height"], center, rtol=4 * FLOAT32, atol=4 * FLOAT32)


def test_largest_stretch_and_kinetic_energy_are_those_of_the_host(device):
    rng = np.random.default_rng(5)
    mesh = quad_sphere(6)
    simulator = Simulator(Scene(balloon=[Balloon(mesh=mesh, mass=0.3, fixed=[4, 9])]), device)
    points = mesh.points + rng.normal(0.0, 0.05, mesh.points.shape)
    velocities = rng.normal(0.0, 1.0, mesh.points.shape)
    simulator.state.points.assign(points[None])
    simulator.state.velocities.assign(velocities[None])
    springs, cluster = simulator.model.shapes[0].springs, simulator.model.shapes[0].mass_share
    lengths = np.linalg.norm(points[springs.pairs[:, 1]] - points[springs.pairs[:, 0]], axis=1)
    found = measured(simulator)
    np.testing.assert_allclose(found["largest_stretch"], np.max(lengths / springs.rest_lengths), rtol=1e-6)
    energy = 0.5 * np.sum(0.3 * cluster * np.sum(velocities**2, axis=1))
    np.testing.assert_allclose(found["kinetic_energy"], energy, rtol=20 * FLOAT32)


def test_a_world_whose_speeds_overflow_is_bad_before_its_places_are(device):
    simulator = Simulator(Scene(balloon=[Balloon(mesh=cube())]), device, 2)
    recorder = recorder_of(simulator)
    recorder.read()
    velocities = np.zeros((2, 8, 3))
    velocities[1, 3, 0] = 1e25  # its square is beyond float32
    simulator.state.velocities.assign(velocities)
    after = recorder.read()
    assert after.healthy.tolist() == [1, 0]
    assert np.isfinite(after.measures).all()


@pytest.mark.full
def test_pressure_is_the_mean_by_area(device):
    """A cube has 6 m^2 under 10 Pa, one 24 m^2 and gas that starts at 40 Pa, a third 100 k_normal over its 6 m^2."""
    balloons = [
        Balloon(mesh=cube(), inflation=Inflation(kind="pressure", pressure=[(0.0, 10.0), (0.02, 30.0)])),
        Balloon(mesh=cube(), scale=2.0, inflation=Inflation(kind="gas", start_pressure=40.0)),
        Balloon(mesh=cube(), inflation=Inflation(k_normal=[(0.0, 0.6), (0.02, 1.2)])),
    ]
    still = [balloon.model_copy(update={"fixed": list(range(8))}) for balloon in balloons]
    scene = Scene(balloon=still, frames_per_second=50, substeps=1000, touch=False)
    simulator = Simulator(scene, device)
    np.testing.assert_allclose(measured(simulator)["pressure"], (6 * 10.0 + 24 * 40.0 + 60.0) / 36, rtol=1e-3)
    simulator.step()
    np.testing.assert_allclose(measured(simulator)["pressure"], (6 * 30.0 + 24 * 40.0 + 120.0) / 36, rtol=1e-3)


FRAMES, WORLDS = 8, 4
VARY = {
    "balloon.mass": [0.1, 0.2, 0.1, 0.3],
    "balloon.inflation.k_normal": [0.2, 0.4, 9e11, 0.2],
    "balloon.position.1": [0.0, 1.0, 2.0, 3.0],
}
"""of which one blows up, and all fall"""


def ending_scene(**fields) -> Scene:
    balloon = Balloon(mesh=quad_sphere(2, 0.1), inflation=Inflation(k_normal=0.2))
    fields = {"balloon": [balloon], "frames": FRAMES, "frames_per_second": 8.0, "substeps": 60} | fields
    return Scene(sphere=[Sphere(position=(0, 9, 0))], **fields)


@pytest.fixture(scope="module")
def written(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("out")
    summary = run_batch(ending_scene(), folder, WORLDS, VARY, export=[0, 2, 3], device="cpu")
    assert [Path(path).name for path in summary.worlds_table] == ["worlds.npz", "worlds.csv"]
    return folder


@pytest.fixture(scope="module")
def tables(written: Path) -> dict[str, dict[str, np.ndarray]]:
    return {name: dict(np.load(written / f"{name}.npz")) for name in ("table", "worlds")}


@pytest.mark.full
def test_each_world_has_a_row_of_ends_and_extremes_and_how_it_ended(
    written: Path, tables: dict[str, dict[str, np.ndarray]]
):
    table, worlds = tables["table"], tables["worlds"]
    measures = columns_of(ending_scene())
    ends = [f"{name}_{end}" for name in measures for end in ("end", "min", "max")]
    assert list(worlds) == ["world", *VARY, "health", "ending", "last_frame", *ends]
    assert worlds["world"].tolist() == [0, 1, 2, 3]
    for path, values in VARY.items():
        np.testing.assert_array_equal(worlds[path], values)
    for name in measures:
        of_frames = table[name].reshape(FRAMES + 1, WORLDS)
        expected = [of_frames[-1], of_frames.min(axis=0), of_frames.max(axis=0)]
        np.testing.assert_array_equal([worlds[f"{name}_{end}"] for end in ("end", "min", "max")], expected)
    assert (worlds["center_height_max"] > worlds["center_height_end"] + 1.0)[[0, 1, 3]].all()
    assert worlds["health"].tolist() == [1, 1, 0, 1]
    assert worlds["ending"].tolist() == ["falling", "finished", "blew up", "falling"]
    assert worlds["last_frame"].tolist() == [FRAMES, FRAMES, 0, FRAMES]
    assert_text_has_the_numbers_of(written / "worlds.npz")


def test_columns_have_units(written: Path, tables: dict[str, dict[str, np.ndarray]]):
    columns = json.loads((written / "manifest.json").read_text())["columns"]
    assert set(columns) == {*tables["table"], *tables["worlds"]}
    assert columns["balloon.mass"]["meaning"].startswith("Mass of the whole balloon")
    units = {"time": "s", "volume": "m^3", "volume_max": "m^3", "sphere_0_height_min": "m"}
    assert_units(columns, units | {"balloon.mass": "kg", "balloon.position.1": "m"})
    gas = Balloon(mesh=quad_sphere(2), inflation=Inflation(pump=[(0, 0), (1, 0.1)]))
    units = {"balloon.mesh": "", "balloon.scale": "1", "balloon.stiffness.seed": "1", "balloon.inflation.pump": "mol/s"}
    units |= {"atmosphere.wind.0": "m/s"}
    told = describe_columns(ending_scene(balloon=[gas], box=Box(lower=(0, 0, 0), upper=(1, 1, 1))), tuple(units))
    assert_units(told, units | {"moles_end": "mol", "thrust_max": "N", "in_box": "1"})


def assert_units(columns: dict[str, Any], units: dict[str, str]) -> None:
    assert {name: columns[name]["unit"] for name in units} == units
    assert all(column["meaning"] for column in columns.values())


KINDS_VARY = {"gravity": [1.0, 5.0, 9.0], "balloon.inflation.k_normal": [0.2, 9e11, 0.4]}  # world 1 blows up


@pytest.mark.full
def test_parquet_has_the_numbers_of_the_npz(tmp_path):
    run_batch(scene(), tmp_path, 3, KINDS_VARY, device="cpu", table="parquet")
    found = pd.read_parquet(tmp_path / "table.parquet")
    with np.load(tmp_path / "table.npz") as columns:
        assert list(found) == list(columns)
        for name in columns:
            np.testing.assert_array_equal(found[name], columns[name], strict=True)
    said = json.loads((tmp_path / "manifest.json").read_text())
    assert said["table"] == "parquet"
    assert {"table.npz", "table.parquet"} <= said["outputs"].keys()
    assert not (tmp_path / "table.csv").exists()


@pytest.mark.full
def test_a_batch_that_was_stopped_goes_on_to_the_same_parquet(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "ROWS", 1)
    run_batch(scene(), tmp_path / "whole", 3, KINDS_VARY, device="cpu", table="parquet")
    run_batch(scene(), tmp_path / "parts", 3, KINDS_VARY, device="cpu")
    how = {"device": "cpu", "table": "parquet", "checkpoint_seconds": OFTEN}
    with pytest.raises(RuntimeError):
        run_batch(scene(), tmp_path / "parts", 3, KINDS_VARY, **how, on_frame=stop_after(3))
    assert (tmp_path / "parts" / "table.csv").exists()
    run_batch(scene(), tmp_path / "parts", 3, KINDS_VARY, **how, resume=True)
    parts, whole = (tmp_path / name / "table.parquet" for name in ("parts", "whole"))
    assert parts.read_bytes() == whole.read_bytes()
    assert not (tmp_path / "parts" / "table.csv").exists()


def test_what_is_replaced_is_written_again(tmp_path):
    columns = (tmp_path, 3, 60.0, table.Columns({"mesh": np.array(["a", "b"])}, ["height"]), 2, "parquet")
    with table.TableWriter(*columns) as rows:
        for _ in range(3):
            rows.write_frame()
        rows.values[:] = 7.0
        rows.write_again()
    found = pd.read_parquet(tmp_path / "table.parquet")
    assert found["height"].tolist() == [7.0] * 6
    assert found["mesh"].tolist() == ["a", "b"] * 3


def test_many_rows_are_parquet_and_few_are_text_and_mistakes_are_told(monkeypatch, tmp_path):
    few, many = table.MOST_CSV_ROWS, table.MOST_CSV_ROWS + 1
    assert [table.resolved_table("auto", rows) for rows in (few, many)] == ["csv", "parquet"]
    assert table.resolved_table("csv", many) == "csv"
    monkeypatch.setattr(table, "has_parquet", lambda: False)
    assert table.resolved_table("auto", many) == "csv"
    with pytest.raises(InputError, match=r"^table xlsx: expected auto, csv, parquet$"):
        run_batch(scene(), tmp_path, 2, device="cpu", table="xlsx")

    monkeypatch.setattr(table, "import_module", Mock(side_effect=ImportError))
    with pytest.raises(MissingExtraError, match=r"^Parquet needs pyarrow: pip install 'balloon-warp\[data\]'$"):
        run_batch(scene(), tmp_path, 2, device="cpu", table="parquet")


PARTS_FRAMES, PARTS_WORLDS = 40, 300
COLUMNS = ("world", "frame", "time", "mesh", "mass", "height", "health")
MESHES = np.array([f"mesh {world % 7}" for world in range(PARTS_WORLDS)])
VARIED = {"mesh": MESHES, "mass": np.linspace(0.1, 0.2, PARTS_WORLDS)}


def test_row_groups_that_are_encoded_side_by_side_are_those_of_one_writer(tmp_path, monkeypatch):
    """Twenty row groups, which is a long list in Thrift, have the bytes that Arrow itself writes in turn."""
    monkeypatch.setattr(table, "ROWS", 2 * PARTS_WORLDS)
    heights = np.random.default_rng(0).normal(size=(PARTS_FRAMES, 1, PARTS_WORLDS)).astype(np.float32)
    health = np.ones(PARTS_WORLDS, dtype=np.int32)
    rows = table.ParquetRows(tmp_path / "parts.parquet", COLUMNS, VARIED, PARTS_WORLDS)
    for frame in range(PARTS_FRAMES):
        rows.write(frame, frame / 60.0, heights[frame], health)
    rows.close()
    found = parquet.ParquetFile(tmp_path / "parts.parquet")
    assert found.num_row_groups == PARTS_FRAMES // 2
    together = found.read()
    np.testing.assert_array_equal(together["height"].to_numpy(), heights.ravel())
    assert together["mesh"].to_pylist() == PARTS_FRAMES * VARIED["mesh"].tolist()
    options = {"compression": "zstd", "compression_level": 1}
    options["use_dictionary"] = [name for name in COLUMNS if name != "height"]
    with parquet.ParquetWriter(tmp_path / "whole.parquet", found.schema_arrow, **options) as writer:
        for frame in range(0, PARTS_FRAMES, 2):
            writer.write_table(together.slice(frame * PARTS_WORLDS, 2 * PARTS_WORLDS), row_group_size=2**31 - 1)
    assert (tmp_path / "parts.parquet").read_bytes() == (tmp_path / "whole.parquet").read_bytes()


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
def test_the_text_of_a_number_is_that_of_nine_digits(values: np.ndarray):
    texts = [row[row != PAD].tobytes() for row in decimals(values)]
    assert texts == [b"%.9g" % value for value in values.tolist()]


def test_a_table_of_many_worlds_is_that_of_its_numbers(tmp_path, monkeypatch):
    monkeypatch.setattr(table, "BLOCK", 3)
    varied = {"balloon.mass": RANDOM.normal(size=11), "balloon.mesh": np.array(['a,"ü".obj'] * 11)}
    with table.TableWriter(tmp_path, 2, 3.0, table.Columns(varied, ["volume", "area"]), 11) as writer:
        writer.values[:] = RANDOM.lognormal(0.0, 9.0, (2, 2, 11))
        writer.health[:] = RANDOM.integers(0, 3, (2, 11))
        for _ in range(2):
            writer.write_frame()
    assert_text_has_the_numbers_of(tmp_path / "table.npz")


@pytest.fixture
def vary(tmp_path) -> dict:
    """Return two meshes, which make two groups, and a push under which the last world blows up."""
    paths = [tmp_path / "coarse.obj", tmp_path / "fine.obj"]
    for number, path in enumerate(paths):
        write_obj(path, quad_sphere(2 + number))
    return {
        "balloon.mesh": [paths[world % 2] for world in range(BATCH_WORLDS)],
        "balloon.inflation.k_normal": [0.2, 0.3, 0.4, 0.5, 9e11],
    }


def run(folder: Path, worlds: int = 2, **how: Any) -> BatchSummary:
    """Simulate a batch whose worlds differ in gravity, which was stopped in `folder` or is begun there."""
    how = {"vary": {"gravity": np.linspace(1, 9, worlds).tolist()}, "device": "cpu", **how}
    return run_batch(scene(), folder, worlds, **how)


def resumed(folder: Path, worlds: int = 2, **how: Any) -> list[str]:
    """Go on with such a batch, require the files of one that was never stopped, and return its messages."""
    notes: list[str] = []
    run(folder, worlds, resume=True, on_note=notes.append, **how)
    run(folder.with_name("whole"), worlds, **how)
    assert contents(folder) == contents(folder.with_name("whole"))
    return notes


@pytest.mark.full
def test_it_goes_on_to_the_same_bytes(vary: dict, schedule: str, device: str, tmp_path, monkeypatch):
    """Stopped twice: before and after the last world blew up."""
    monkeypatch.setattr(growing, "SAVE_BYTES", 10_000)
    how = {"vary": vary, "export": [1, 4], "device": device, "schedule": schedule}
    parts, frames, notes = tmp_path / "parts", [], []
    run(tmp_path / "whole", BATCH_WORLDS, **how)
    for last in (2, 5):
        with pytest.raises(RuntimeError, match="stopped"):
            run(parts, BATCH_WORLDS, **how, checkpoint_seconds=OFTEN, resume=True, on_frame=stop_after(last))
    assert contents(parts) == {}
    summary = run(parts, BATCH_WORLDS, **how, resume=True, on_frame=frames.append, on_note=notes.append)
    assert frames == [5, 6]
    assert notes == [f"resuming after frame 4, from {parts / 'partial'}"]
    assert summary.resumed == pytest.approx(4 / BATCH_FRAMES, abs=1e-3)
    assert summary.unhealthy_worlds == 1
    assert contents(parts) == contents(tmp_path / "whole")
    assert sorted(path.name for path in parts.iterdir()) == sorted([*NAMES, "manifest.json"])


def test_what_was_saved_opens(tmp_path):
    partial, whole = tmp_path / "partial", tmp_path / "whole"
    with pytest.raises(RuntimeError):
        run(tmp_path, 3, export=[2], checkpoint_seconds=OFTEN, on_frame=stop_after(4))
    run(whole, 3, export=[2])
    stages = sorted(partial.glob("frames_*.usdc"))
    assert len(stages) == 4
    opened, played = Usd.Stage.Open(str(whole / "worlds.usdc")), Usd.Stage.Open(str(partial / "frames.usda"))
    meshes = (str(prim.GetPath()) for prim in opened.Traverse() if prim.IsA(UsdGeom.Mesh))
    path = next(mesh for mesh in meshes if "World_2" in mesh)
    assert (played.GetStartTimeCode(), played.GetEndTimeCode()) == (0, 3)
    for number, stage_path in enumerate(stages):
        stage = Usd.Stage.Open(str(stage_path))
        assert (stage.GetStartTimeCode(), stage.GetEndTimeCode()) == (number, number)
        alone, together, expected = (
            UsdGeom.Mesh(each.GetPrimAtPath(path)).GetPointsAttr().Get(number) for each in (stage, played, opened)
        )
        np.testing.assert_array_equal(alone, expected)
        np.testing.assert_array_equal(together, expected)


@pytest.fixture
def stopped(tmp_path) -> Path:
    """Return the folder of a batch that was stopped after frame 3, and saved after frame 2."""
    with pytest.raises(RuntimeError):
        run(tmp_path / "stopped", checkpoint_seconds=OFTEN, on_frame=stop_after(3))
    return tmp_path / "stopped"


def test_rows_without_their_stage_are_never_there(tmp_path, monkeypatch):
    rows, out = BatchOutput.rows, tmp_path / "out"

    def kill(self: BatchOutput, part: Part) -> dict[str, np.ndarray]:
        if part.frames.start == 2:
            assert (out / "partial" / "frames_000002.usdc").exists()
            raise RuntimeError("killed")
        return rows(self, part)

    monkeypatch.setattr(BatchOutput, "rows", kill)
    with pytest.raises(RuntimeError, match="killed"):
        run(out, export=[1], checkpoint_seconds=OFTEN)
    monkeypatch.undo()
    assert resumed(out, export=[1]) == [f"resuming after frame 1, from {out / 'partial'}"]


def test_a_state_without_its_rows_is_not_gone_on_from(stopped: Path):
    """A kill between the two leaves it like that."""
    (stopped / "partial" / "state_000003_0000.npz").write_bytes(b"of a frame whose rows are not there")
    assert resumed(stopped) == [f"resuming after frame 2, from {stopped / 'partial'}"]


def test_ctrl_c_saves_the_frame_that_it_finds_and_no_later_one_is_simulated(tmp_path):
    frames: list[int] = []
    press = press_ctrl_c_once(lambda frame: frame == 3)

    def look(frame: int) -> None:
        frames.append(frame)
        press(frame)

    plays = r"partial/frames\.usda plays the frames so far, and --resume continues from them$"
    with pytest.raises(KeyboardInterrupt, match=plays):
        run(tmp_path / "out", export=[1], checkpoint_seconds=0.0, on_frame=look)
    assert frames == [0, 1, 2, 3]
    run(tmp_path / "out", export=[1], resume=True, on_frame=frames.append)
    assert frames == [*range(BATCH_FRAMES + 1)]
    run(tmp_path / "whole", export=[1])
    assert contents(tmp_path / "out") == contents(tmp_path / "whole")
