"""Stages as arrays and grids, read back by h5py, xarray and meshio where they are installed."""

import itertools
import re
import xml.etree.ElementTree as ElementTree
from base64 import b64decode
from pathlib import Path

import numpy as np
import pytest
import xarray
from exported import BALL, FRAMES, RATE, STRING, points, scene
from pxr import Usd, UsdGeom

from balloon_warp import InputError, MissingExtraError, animate, export_stage
from balloon_warp.mesh.corners import edges_of
from balloon_warp.outputs import hdf5_arrays
from balloon_warp.scene import Balloon

PAGE = (Path(__file__).parent.parent / "docs" / "OUTPUTS.md").read_text(encoding="utf-8")
TYPES = {"Float32": np.float32, "Int64": np.int64, "UInt8": np.uint8}


@pytest.fixture(scope="module", params=["Y", "Z"])
def written(request, tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("exports") / "stage.usdc"
    animate(scene(up_axis=request.param), path, device="cpu")
    return path


def arrays(path: Path) -> dict[str, np.ndarray]:
    """Return the arrays of a .vtu file, by VTK's description of the format."""
    root = ElementTree.parse(path).getroot()
    assert (root.get("type"), root.get("header_type"), root.get("byte_order")) == (
        *("UnstructuredGrid", "UInt64", "LittleEndian"),
    )
    found = {}
    for array in root.iter("DataArray"):
        data = b64decode(array.text or "")
        assert int.from_bytes(data[:8], "little") == len(data) - 8
        values = np.frombuffer(data[8:], TYPES[array.get("type", "")])
        found[array.get("name") or array.get("Name", "")] = values.reshape(-1, int(array.get("NumberOfComponents", 1)))
    piece = next(root.iter("Piece"))
    assert int(piece.get("NumberOfPoints", 0)) == len(found["points"]) == len(found["velocity"])
    assert int(piece.get("NumberOfCells", 0)) == len(found["types"]) == len(found["pressure"])
    return found


@pytest.mark.full
def test_h5py_reads_all_that_moved(written: Path, tmp_path):
    h5py = pytest.importorskip("h5py")
    export_stage(written, tmp_path / "out.h5")
    stage = Usd.Stage.Open(str(written))
    with h5py.File(tmp_path / "out.h5") as file:
        assert set(file) == {"ball", "box", "Sphere_0", "Sphere_1", *STRING, "Obstacles_box"}
        assert file.attrs["up_axis"] == UsdGeom.GetStageUpAxis(stage)
        ball, prim = file["ball"], UsdGeom.Mesh(stage.GetPrimAtPath("/World/ball"))
        assert ball["mesh_pos"].shape == (FRAMES + 1, len(BALL.points), 3)
        np.testing.assert_allclose(ball["time"], np.arange(FRAMES + 1) / RATE)
        for frame in range(FRAMES + 1):
            np.testing.assert_array_equal(ball["mesh_pos"][frame], prim.GetPointsAttr().Get(frame))
            np.testing.assert_array_equal(ball["velocity"][frame], prim.GetVelocitiesAttr().Get(frame))
            volume = prim.GetPrim().GetAttribute("userProperties:volume").Get(frame)
            assert ball["volume"][frame] == volume
        np.testing.assert_array_equal(ball["face_vertex_indices"], BALL.face_vertex_indices)
        assert len(ball["edges"]) == len(BALL.points) + BALL.face_count - 2  # Euler's formula
        sphere = UsdGeom.XformCache(3.0).GetLocalToWorldTransform(stage.GetPrimAtPath("/World/Spheres/Sphere_0"))
        np.testing.assert_allclose(file["Sphere_0"]["pose"][3], np.array(sphere), rtol=1e-6)


def test_xarray_knows_the_dimensions(written: Path, tmp_path):
    export_stage(written, tmp_path / "out.h5")
    with xarray.open_dataset(tmp_path / "out.h5", group="ball", engine="h5netcdf") as found:
        assert found["mesh_pos"].dims == found["velocity"].dims == ("time", "particle", "axis")
        assert found["mesh_pos"].attrs["units"] == "m"
        assert found["edges"].dims == ("edge", "end")
        assert float(found["volume"].sel(time=3.0 / RATE, method="nearest")) > 0.0


@pytest.fixture(scope="module")
def page_file(tmp_path_factory) -> Path:
    """Write points.h5 of a balloon called "squirrel", as in docs/OUTPUTS.md."""
    h5py = pytest.importorskip("h5py")
    folder = tmp_path_factory.mktemp("page")
    animate(scene(balloon=[Balloon(mesh=BALL, name="squirrel")]), folder / "out.usdc", device="cpu")
    export_stage(folder / "out.usdc", folder / "points.h5")
    assert h5py.is_hdf5(folder / "points.h5")
    return folder / "points.h5"


@pytest.mark.full
def test_a_file_has_what_its_page_says(page_file: Path):
    """The file has each dataset of the table and no other, in shapes whose letters agree, and the attributes."""
    h5py = pytest.importorskip("h5py")
    rows = [line.split("|")[1:3] for line in PAGE.splitlines() if re.match(r"\| `\w+`.*\| \(", line)]
    said = {}
    for names, shapes in rows:
        found = zip(re.findall(r"`(\w+)`", names), itertools.cycle(re.findall(r"\(([^)]*)\)", shapes)))
        said |= {name: [size.strip() for size in shape.split(",") if size.strip()] for name, shape in found}
    assert len(said) >= 10
    sizes: dict[str, int] = {"3": 3, "2": 2, "T": FRAMES + 1, "N": len(BALL.points), "faces": BALL.face_count}
    with h5py.File(page_file) as file:
        # Lengths alone, such as of "particle", stand beside them, as netCDF has it.
        assert set(said) == {name for name, data in file["squirrel"].items() if name == "time" or not data.is_scale}
        for name, shape in said.items():
            there = file["squirrel"][name].shape
            assert [sizes.setdefault(size, n) for size, n in zip(shape, there, strict=True)] == list(there), name
        for attribute in ("up_axis", "meters_per_unit", "frames_per_second"):
            assert attribute in PAGE
            assert attribute in file.attrs
        for group in ("Sphere_0", "box", "String_0_Knot"):
            ((count, three), pose) = (file[group][name].shape for name in ("points", "pose"))
            assert (count > 0, three, pose) == (True, 3, (FRAMES + 1, 4, 4))


def test_xarray_opens_it_as_its_page_says(page_file: Path, monkeypatch):
    monkeypatch.chdir(page_file.parent)
    (line,) = re.findall(r"^(found = xarray\..*)$", PAGE, re.MULTILINE)
    said: dict[str, xarray.Dataset] = {}
    exec(line, {"xarray": xarray}, said)
    with said["found"] as found:
        assert found["mesh_pos"].dims == ("time", "particle", "axis")


def test_xarray_makes_a_zarr_store_of_it_as_its_page_says(page_file: Path, monkeypatch):
    pytest.importorskip("zarr")
    monkeypatch.chdir(page_file.parent)
    (line,) = re.findall(r"^(found\.to_zarr.*)$", PAGE, re.MULTILINE)
    with xarray.open_dataset(page_file, group="squirrel", engine="h5netcdf") as found:
        exec(line, {"found": found})
    with xarray.open_zarr(page_file.parent / "squirrel.zarr") as kept:
        assert kept["mesh_pos"].dims == ("time", "particle", "axis")


def test_edges_are_the_sides_of_faces():
    pairs = edges_of(BALL)
    assert (pairs[:, 0] < pairs[:, 1]).all()
    assert len(np.unique(pairs, axis=0)) == len(pairs) == 2 * BALL.face_count  # closed, of quads


def test_a_grid_for_each_frame_and_a_list_of_their_times(written: Path, tmp_path):
    export_stage(written, tmp_path / "out.pvd")
    listed = list(ElementTree.parse(tmp_path / "out.pvd").getroot().iter("DataSet"))
    assert [entry.get("file") for entry in listed] == [f"out.{frame:04d}.vtu" for frame in range(FRAMES + 1)]
    np.testing.assert_allclose([float(entry.get("timestep", -1)) for entry in listed], np.arange(FRAMES + 1) / RATE)
    stage = Usd.Stage.Open(str(written))
    fastest = 0.0
    for frame, entry in enumerate(listed):
        grid = arrays(tmp_path / str(entry.get("file")))
        ball = grid["points"][: len(BALL.points)]
        np.testing.assert_allclose(ball, points(written, "/World/ball", frame), atol=1e-6)
        np.testing.assert_array_equal(
            grid["connectivity"][: len(BALL.face_vertex_indices), 0], BALL.face_vertex_indices
        )
        np.testing.assert_array_equal(grid["offsets"][: BALL.face_count, 0], np.cumsum(BALL.face_vertex_counts))
        assert set(grid["types"][:, 0].tolist()) == {9}
        assert grid["connectivity"].max() == len(grid["points"]) - 1
        pressure = stage.GetPrimAtPath("/World/ball").GetAttribute("userProperties:pressure").Get(frame)
        np.testing.assert_allclose(grid["pressure"][: BALL.face_count], pressure, rtol=1e-6)
        assert len(np.unique(grid["part"])) == 6 + (frame >= 2)
        fastest = max(fastest, float(np.abs(grid["velocity"]).max()))
    assert fastest > 0.0


def test_meshio_reads_the_grids(written: Path, tmp_path):
    meshio = pytest.importorskip("meshio")
    export_stage(written, tmp_path / "out.pvd")
    found = meshio.read(tmp_path / "out.0003.vtu")
    np.testing.assert_allclose(found.points[: len(BALL.points)], points(written, "/World/ball", 3), atol=1e-6)
    assert [cells.type for cells in found.cells] == ["quad"]
    assert set(found.cell_data) == {"part", "pressure"}


def test_points_are_saved_beside_the_stage(tmp_path):
    pytest.importorskip("h5py")
    small = scene(frames=2)
    summary = animate(small, tmp_path / "out.usdc", save_points=tmp_path / "points.h5", device="cpu")
    assert summary.points == str(tmp_path / "points.h5")
    export_stage(tmp_path / "out.usdc", tmp_path / "same.h5")
    assert (tmp_path / "same.h5").read_bytes() == (tmp_path / "points.h5").read_bytes()


def test_mistakes_are_told_before_any_work(written: Path, tmp_path, monkeypatch):
    told: list[int] = []
    with pytest.raises(InputError, match=r"points\.npy: cannot hold points; expected \.h5 or \.hdf5"):
        animate(scene(), tmp_path / "out.usdc", save_points=tmp_path / "points.npy", on_frame=told.append)

    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(hdf5_arrays, "import_module", missing)
    for output, how in (("out.h5", {}), ("out.usdc", {"save_points": tmp_path / "points.h5"})):
        with pytest.raises(MissingExtraError, match=r"an \.h5 needs h5py: pip install 'balloon-warp\[data\]'"):
            animate(scene(), tmp_path / output, on_frame=told.append, **how)
    assert told == []
    assert list(tmp_path.iterdir()) == []
