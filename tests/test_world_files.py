"""Files of worlds: their contents and readers; they are whole, and the same by any path of a batch."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray
from batches import FRAMES, OFTEN, scene, stop_after
from commands import contents
from meshes import quad_sphere
from numpy.typing import NDArray

from balloon_warp import InputError, MissingExtraError, TrajectoryFiles, repeat_batch, run_batch, simulate
from balloon_warp.batch import trajectories
from balloon_warp.batch.table import FORMATS, Field, FileContents, chunks_of
from balloon_warp.batch.trajectories import Moments, splits_of
from balloon_warp.mesh.obj import write_obj
from balloon_warp.run.report import describe_scene, hash_of_file
from balloon_warp.scene import Balloon, Scene
from balloon_warp.system import files as arrays

DATA_PAGE = (Path(__file__).parents[1] / "docs" / "DATA.md").read_text()
WORLDS = 5
VARY = {"balloon.mass": np.linspace(1.0, 2.0, WORLDS), "gravity": np.linspace(1.0, 9.0, WORLDS)}
BLOWS_UP = {"balloon.inflation.k_normal": [0.2, 9e11, 0.4, 0.5, 0.3]}
"""world 1 does"""


def batch(folder: Path, format_: str = "h5", vary: dict[str, Any] = VARY, every: int = 1, **how: Any) -> Path:
    """Run a small batch and return the folder of its trajectories."""
    files = TrajectoryFiles(folder / "data", every, format_, seed=2)  # world 4 is for test
    run_batch(scene(contacts=True), folder / "out", WORLDS, vary, device="cpu", trajectories=files, **how)
    return folder / "data"


def manifest(data: Path) -> dict[str, Any]:
    return json.loads((data / "manifest.json").read_text())


def world_file(data: Path, world: int) -> Path:
    return next(data.glob(f"*/world_{world:06d}.*"))


def arrays_of(path: Path) -> dict[str, NDArray]:
    """Return the arrays of a world, with those that it shares with others."""
    return own_arrays_of(path.parents[1] / attributes_of(path)["static"]) | own_arrays_of(path)


def own_arrays_of(path: Path) -> dict[str, NDArray]:
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


@pytest.fixture(scope="module", params=list(FORMATS))
def data(request, tmp_path_factory) -> Path:
    return batch(tmp_path_factory.mktemp(request.param), request.param, every=2)


def test_they_hold_what_moved(data: Path):
    moved = simulate(scene(contacts=True), world_count=WORLDS, vary=VARY, every=2, device="cpu")
    assert moved.volumes.shape[:2] == (WORLDS, 4)
    for world in range(WORLDS):
        found = arrays_of(world_file(data, world))
        np.testing.assert_array_equal(found["mesh_pos"], moved.points[0][world])
        np.testing.assert_array_equal(found["velocity"], moved.velocities[0][world])
        np.testing.assert_array_equal(found["pressure"], moved.pressures[world])
        np.testing.assert_array_equal(found["sphere_pos"], moved.sphere_positions[world])
        np.testing.assert_allclose(found["volume"], moved.volumes[world], rtol=1e-5)  # float32
        np.testing.assert_allclose(found["time"], np.arange(0, FRAMES + 1, 2) / scene().frames_per_second)
        np.testing.assert_array_equal(found["health"], [1, 1, 1, 1])
        assert found["contact_force"].shape == (4, 1, 3, 3)
        assert found["particle_contact_force"].shape == found["mesh_pos"].shape
        mesh = moved.meshes[0]
        assert len(found["edges"]) == mesh.vertex_count + mesh.face_count - 2  # Euler's formula
        np.testing.assert_array_equal(found["rest_pos"], mesh.points.astype(np.float32))


def test_they_say_what_differs_and_the_manifest_lists_them(data: Path):
    for world in range(WORLDS):
        told = attributes_of(world_file(data, world))
        assert (told["world"], told["health"], told["every"]) == (world, 1, 2)
        for path in ("balloon.mass", "balloon.0.mass"):
            assert told[path] == VARY["balloon.mass"][world]
        assert told["gravity"] == VARY["gravity"][world]
        assert told["string.0.length"] == 1.5
        assert json.loads(told["units"])["balloon.0.mass"] == "kg"
    said = manifest(data)
    listed = sorted(name for names in said["splits"].values() for name in names)
    assert listed == sorted(str(path.relative_to(data)) for path in data.glob("*/world_*"))
    assert set(said["fields"]) <= set(arrays_of(world_file(data, 0)))
    assert said["fields"]["mesh_pos"]["unit"] == "m"
    assert (said["blew_up"], said["restarted"], said["scene"]) == ([], [], describe_scene(scene(contacts=True)))
    assert not list(data.glob("partial*"))
    folders = [data / split for split, names in manifest(data)["splits"].items() if names]
    samples = [arrays_of(path) for folder in folders for path in sorted(folder.iterdir())]
    assert len(samples) == WORLDS
    for sample in samples:
        assert sample.keys() == samples[0].keys()
        assert all(array.ndim >= 1 and array.dtype.isnative for array in sample.values())
        assert {array.dtype.str[1:] for array in sample.values()} <= {"f4", "f8", "i4"}


@pytest.mark.parametrize("format_", list(FORMATS))
def test_they_do_not_tell_where_they_were_made(format_: str, tmp_path: Path):
    """Names of files without folders, and hashes of meshes: the same bytes wherever the meshes stand."""
    made = []
    for number, home in enumerate((tmp_path / "at home", tmp_path / "elsewhere")):
        home.mkdir()
        meshes = [home / f"of_{sides}.obj" for sides in (2, 3)]
        for mesh, sides in zip(meshes, (2, 3), strict=True):
            write_obj(mesh, quad_sphere(sides))
        balloon = scene().balloon[0].model_copy(update={"mesh": meshes[0]})
        files = TrajectoryFiles(tmp_path / f"data_{number}", format=format_)
        vary = {"balloon.mesh": list(map(str, meshes))}
        run_batch(scene(balloon=[balloon]), home / "out", 2, vary, device="cpu", trajectories=files)
        made.append(contents(Path(files.folder)))
    assert made[0] == made[1]
    assert not any(str(tmp_path).encode() in content for content in made[0].values())
    for world, mesh in enumerate(sorted((tmp_path / "elsewhere").glob("*.obj"))):
        told = attributes_of(world_file(tmp_path / "data_1", world))
        assert told["balloon.mesh"] == told["balloon.0.mesh"] == mesh.name
        assert told["balloon.mesh.sha256"] == told["balloon.0.mesh.sha256"] == hash_of_file(mesh)


STATIC = {"rest_pos", "mass_share", "particle_balloon", "edges", "triangles"}


def test_there_are_no_arrays_but_the_real_ones_and_what_stays_is_there_once(data: Path):
    said = manifest(data)
    (static,) = said["static"]
    assert [str(path.relative_to(data)) for path in data.glob("static/*")] == [static]
    assert own_arrays_of(data / static).keys() == STATIC
    for path in data.glob("*/world_*"):
        own = own_arrays_of(path)
        assert attributes_of(path)["static"] == static
        assert own.keys() == set(said["fields"]) - (STATIC if path.suffix != ".h5" else set())  # links, in the latter
        if path.suffix == ".h5":
            with h5py.File(path) as file:
                linked = {name for name in file if isinstance(file.get(name, getlink=True), h5py.ExternalLink)}
                assert linked == STATIC
                assert [label.label for label in file["mesh_pos"].dims] == ["time", "particle", "axis"]


def test_the_manifest_has_mean_and_deviation_for_training(data: Path):
    said = manifest(data)
    moving = set(said["fields"]) - STATIC - {"time"}
    assert len(said["splits"]["train"]) == 4
    worlds = [own_arrays_of(data / name) for name in said["splits"]["train"]]
    for name in moving:
        values = np.concatenate([world[name] for world in worlds]).astype(np.float64)
        wide = said["fields"][name]["dimensions"][-1] in ("axis", "quaternion")
        axes = tuple(range(values.ndim - wide))
        np.testing.assert_allclose(said["fields"][name]["mean"], values.mean(axis=axes), rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(said["fields"][name]["deviation"], values.std(axis=axes), rtol=1e-9, atol=1e-12)
    assert not any("mean" in said["fields"][name] for name in STATIC)


def test_moments_of_pieces_are_those_of_the_whole():
    values = (1e4 + np.random.default_rng(0).normal(size=(50, 3000, 3))).astype(np.float32)  # in three pieces
    field = Field("f", ("time", "particle", "axis"), values.shape, "<f4", "m", "")
    assert len(list(chunks_of(field, values))) == 4
    told = Moments.of(field, values[:20]).with_more(Moments.of(field, values[20:])).as_json()
    np.testing.assert_allclose(told["mean"], values.mean(axis=(0, 1), dtype=np.float64), rtol=1e-13)
    np.testing.assert_allclose(told["deviation"], values.astype(np.float64).std(axis=(0, 1)), rtol=1e-9)


@pytest.mark.parametrize("format_", list(FORMATS))
@pytest.mark.parametrize("shape", [(50, 3000, 3), (7, 50000, 3), (1, 2)])
def test_files_are_compressed_and_read_back_bit_for_bit(format_: str, shape: tuple[int, ...], tmp_path):
    values = np.random.default_rng(0).normal(size=shape).astype(np.float32)
    field = Field("f", ("time", "particle", "axis")[: len(shape)], shape, "<f4", "m", "")
    path = tmp_path / f"it.{format_}"
    FORMATS[format_]().write(path, FileContents({"static": ""}, [(field, values)]))
    found = own_arrays_of(path)["f"]
    assert found.dtype == values.dtype
    np.testing.assert_array_equal(found, values)
    size = sum(file.stat().st_size for file in [path, *path.rglob("*")] if file.is_file())
    if values.nbytes > 1e5:
        assert size < 0.95 * values.nbytes, size / values.nbytes


def test_meshes_that_differ_have_a_file_each(tmp_path):
    meshes = [quad_sphere(2), quad_sphere(3)]
    vary = {"balloon.mesh": [meshes[1], meshes[0], meshes[1]], "balloon.mass": [1.0, 2.0, 3.0]}
    files = TrajectoryFiles(tmp_path / "data", format="npz")
    run_batch(scene(), tmp_path / "out", 3, vary, device="cpu", trajectories=files)
    names = [attributes_of(world_file(tmp_path / "data", world))["static"] for world in range(3)]
    assert names == [f"static/static_{number:06d}.npz" for number in (0, 1, 0)]
    assert manifest(tmp_path / "data")["static"] == sorted(set(names))
    for world, mesh in enumerate(vary["balloon.mesh"]):
        found = arrays_of(world_file(tmp_path / "data", world))
        assert found["mesh_pos"].shape[1] == len(found["rest_pos"]) == mesh.vertex_count


@pytest.mark.parametrize("data", ["h5", "zarr"], indirect=True)
def test_xarray_knows_the_dimensions_as_the_page_says(data: Path):
    said: dict[str, Any] = {"path": world_file(data, 0), "h5py": h5py, "xarray": xarray}
    if said["path"].suffix == ".h5":
        (lines,) = re.findall(r"```py\n(with h5py.*?)```", DATA_PAGE, re.DOTALL)
        exec(lines, said)
    else:
        pytest.importorskip("zarr")
        said["world"] = xarray.open_dataset(said["path"], engine="zarr")
    with said["world"] as found:
        assert found["mesh_pos"].dims == found["velocity"].dims == ("time", "particle", "axis")
        assert found["volume"].dims == ("time", "balloon")
        assert found["mesh_pos"].sel(time=0.02, method="nearest").shape == (found.sizes["particle"], 3)
        assert found.attrs["gravity"] == 1.0


@pytest.mark.full
@pytest.mark.parametrize("format_", ["h5", "npz"])
def test_a_batch_that_was_stopped_goes_on_to_the_same_bytes(format_: str, tmp_path, monkeypatch):
    (tmp_path / "whole").mkdir()
    (tmp_path / "parts").mkdir()
    whole = batch(tmp_path / "whole", format_, BLOWS_UP)
    monkeypatch.setattr(trajectories, "BLOCK_BYTES", 1)
    for last in (1, 4):
        how = {"checkpoint_seconds": OFTEN, "resume": True, "on_frame": stop_after(last)}
        with pytest.raises(RuntimeError, match="stopped"):
            batch(tmp_path / "parts", format_, BLOWS_UP, **how)
    notes: list[str] = []
    data = batch(tmp_path / "parts", format_, BLOWS_UP, resume=True, on_note=notes.append)
    assert notes[0].startswith("resuming after frame 3")
    assert contents(data) == contents(whole)


@pytest.mark.full
@pytest.mark.parametrize("format_", list(FORMATS))
def test_a_world_that_blew_up_has_its_flag_and_no_bad_number(format_: str, tmp_path):
    data = batch(tmp_path, format_, BLOWS_UP)
    bad = arrays_of(world_file(data, 1))
    first = int(np.argmin(bad["health"]))
    assert 0 < first <= FRAMES
    assert all(np.isfinite(array).all() for array in bad.values())
    for name in ("mesh_pos", "velocity", "volume"):
        for frame in range(first, FRAMES + 1):
            np.testing.assert_array_equal(bad[name][frame], bad[name][first - 1])
    told = [attributes_of(world_file(data, world))["health"] for world in range(WORLDS)]
    assert told == [1, 0, 1, 1, 1]
    assert manifest(data)["blew_up"] == [str(world_file(data, 1).relative_to(data))]


def test_a_batch_repeats_them(tmp_path):
    write_obj(tmp_path / "ball.obj", quad_sphere(2))
    ball = Scene(balloon=[Balloon(mesh=tmp_path / "ball.obj")], frames=3)
    files = TrajectoryFiles(tmp_path / "data", every=2, format="npz", seed=4)
    run_batch(ball, tmp_path / "out", 2, {"balloon.mass": [1.0, 2.0]}, device="cpu", trajectories=files)
    repeat_batch(tmp_path / "out" / "manifest.json", tmp_path / "again", trajectories=tmp_path / "more")
    assert contents(tmp_path / "more") == contents(tmp_path / "data")
    run_batch(ball, tmp_path / "bare", 1, device="cpu")
    with pytest.raises(InputError, match=r"manifest\.json: has no trajectories; expected those of a batch with"):
        repeat_batch(tmp_path / "bare" / "manifest.json", tmp_path / "again", trajectories=tmp_path / "none")


def test_a_failed_batch_leaves_the_good_files(tmp_path):
    data = batch(tmp_path)
    good = contents(data)
    with pytest.raises(RuntimeError, match="stopped"):
        batch(tmp_path, vary={"gravity": [9.0] * WORLDS}, on_frame=stop_after(4))
    assert contents(data) == good


@pytest.mark.full
@pytest.mark.parametrize("second", ["h5", "npz"])
def test_another_batch_takes_the_place_of_all(second: str, tmp_path):
    data = batch(tmp_path)
    (data / "notes.txt").touch()
    run_batch(scene(), tmp_path / "out", 2, device="cpu", trajectories=TrajectoryFiles(data, format=second))
    left = {path.name for path in data.rglob("*") if path.is_file()}
    names = {f"{name}.{second}" for name in ("static_000000", "world_000000", "world_000001")}
    assert left == {"notes.txt", "manifest.json", *names}


def test_splits_depend_on_seed_and_number():
    many = splits_of(1000, 3)
    assert np.bincount(many).tolist() == [800, 100, 100]
    np.testing.assert_array_equal(splits_of(137, 3), many[:137])
    assert (splits_of(1000, 4) != many).any()


@pytest.mark.parametrize(
    ("how", "complaint"),
    [
        (lambda at: {"trajectories": at / "missing" / "data"}, r"data: the folder .*missing does not exist$"),
        (lambda at: {"trajectories": at / "file"}, "file: is a file; expected a folder$"),
        (lambda at: {"trajectories": at / "out"}, r"^trajectories .*out: is the batch's own folder; expected"),
        (lambda at: {"trajectories": TrajectoryFiles(at, every=0)}, r"^every 0: expected a whole number"),
        (lambda at: {"trajectories": TrajectoryFiles(at, format="csv")}, "^format: must be h5 or zarr or npz"),
    ],
)
def test_mistakes_are_told_before_the_run(how: Callable[[Path], dict[str, Any]], complaint: str, tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=complaint):
        run_batch(scene(), tmp_path / "out", 2, device="cpu", **how(tmp_path), on_frame=never)


def never(frame: int) -> None:
    raise AssertionError(frame)


def test_a_missing_extra_and_a_disk_that_is_too_small_are_told(tmp_path, monkeypatch):
    def missing(name: str) -> None:
        raise ImportError(name)

    monkeypatch.setattr(arrays, "import_module", missing)
    with pytest.raises(MissingExtraError, match=r"h5py: pip install 'balloon-warp\[data\]'"):
        run_batch(scene(), tmp_path / "out", 2, device="cpu", trajectories=tmp_path / "data")
    run_batch(scene(), tmp_path / "out", 2, device="cpu", trajectories=TrajectoryFiles(tmp_path / "data", format="npz"))
    monkeypatch.undo()
    monkeypatch.setattr(trajectories.shutil, "disk_usage", lambda folder: type("Disk", (), {"free": 10}))
    with pytest.raises(InputError, match=r"data: the trajectories need 0\.00 GiB, and the disk has 0\.00 GiB;"):
        run_batch(scene(), tmp_path / "out", 2, device="cpu", trajectories=tmp_path / "data", on_frame=never)


def test_those_of_another_batch_are_not_gone_on_with(tmp_path):
    with pytest.raises(RuntimeError):
        batch(tmp_path, checkpoint_seconds=OFTEN, on_frame=stop_after(3))
    run_batch(scene(), tmp_path / "other", 2, device="cpu", trajectories=tmp_path / "data")
    with pytest.raises(InputError, match=r"^--resume: .*partial lacks the trajectories of this batch; expected"):
        batch(tmp_path, resume=True)
