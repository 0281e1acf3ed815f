"""Files of worlds: their contents and readers."""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
import xarray
from meshes import quad_sphere
from stopped_batch import FRAMES, scene
from world_file_batches import VARY, WORLDS, arrays_of, attributes_of, batch, manifest, world_file

from balloon_warp import TrajectoryFiles, run_batch, simulate
from balloon_warp.outputs.world_files import FORMATS
from balloon_warp.provenance import describe_scene
from balloon_warp.scene import Balloon, Ground, Scene


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


def test_contact_forces_on_particles_add_up(tmp_path):
    """Contact forces on particles sum to the balloon's in every frame; a scene without contacts has neither."""
    ball = Balloon(mesh=quad_sphere(3, 0.5), position=(0.0, 0.5, 0.0), velocity=(0.0, -1.0, 0.0))
    for contacts in (True, False):
        falling = Scene(balloon=[ball], ground=Ground(), contacts=contacts, frames=4)
        out, files = tmp_path / f"out_{contacts}", TrajectoryFiles(tmp_path / f"data_{contacts}", 2, "npz")
        run_batch(falling, out, 2, {"balloon.mass": [0.1, 0.3]}, device="cpu", trajectories=files)
    for world in range(2):
        found = arrays_of(world_file(tmp_path / "data_True", world))
        net = found["contact_force"].sum(axis=2)[:, 0]
        np.testing.assert_allclose(found["particle_contact_force"].sum(axis=1), net, atol=1e-5 * np.abs(net).max())
        assert (net[1:, 1] > 0.0).all()
        without = arrays_of(world_file(tmp_path / "data_False", world))
        assert found.keys() - without.keys() == {"contact_force", "particle_contact_force"}


def test_they_say_what_differs(data: Path):
    for world in range(WORLDS):
        told = attributes_of(world_file(data, world))
        assert (told["world"], told["health"], told["every"]) == (world, 1, 2)
        for path in ("balloon.mass", "balloon.0.mass"):
            assert told[path] == VARY["balloon.mass"][world]
        assert told["gravity"] == VARY["gravity"][world]
        assert told["string.0.length"] == 1.5
        assert json.loads(told["units"])["balloon.0.mass"] == "kg"


def test_the_manifest_lists_them(data: Path):
    said = manifest(data)
    assert sorted(name for names in said["splits"].values() for name in names) == sorted(
        str(path.relative_to(data)) for path in data.glob("*/world_*")
    )
    assert set(said["fields"]) <= set(arrays_of(world_file(data, 0)))
    assert said["fields"]["mesh_pos"]["unit"] == "m"
    assert (said["blew_up"], said["restarted"], said["scene"]) == ([], [], describe_scene(scene(contacts=True)))
    assert not list(data.glob("partial*"))


def test_readers_of_folders_take_them(data: Path):
    """PhysicsNeMo's readers accept the folders: a sample a file, with the same arrays at the top of each."""
    folders = [data / split for split, names in manifest(data)["splits"].items() if names]
    samples = [arrays_of(path) for folder in folders for path in sorted(folder.iterdir())]
    assert len(samples) == WORLDS
    for sample in samples:
        assert sample.keys() == samples[0].keys()
        assert all(array.ndim >= 1 and array.dtype.isnative for array in sample.values())
        assert {array.dtype.str[1:] for array in sample.values()} <= {"f4", "f8", "i4"}


@pytest.mark.parametrize("data", ["h5", "zarr"], indirect=True)
def test_xarray_knows_the_dimensions(data: Path):
    engine = {".h5": "h5netcdf", ".zarr": "zarr"}[world_file(data, 0).suffix]
    pytest.importorskip(engine)
    with xarray.open_dataset(world_file(data, 0), engine=engine) as found:
        assert found["mesh_pos"].dims == found["velocity"].dims == ("time", "particle", "axis")
        assert found["volume"].dims == ("time", "balloon")
        assert found["mesh_pos"].attrs["units"] == "m"
        assert found["mesh_pos"].sel(time=0.02, method="nearest").shape == (len(found["rest_pos"]), 3)
        assert found.attrs["gravity"] == 1.0


@pytest.mark.parametrize("data", ["h5"], indirect=True)
def test_torch_makes_batches_of_them(data: Path):
    torch = pytest.importorskip("torch")

    class Worlds(torch.utils.data.Dataset):
        files = sorted(data.glob("*/*.h5"))

        def __len__(self) -> int:
            return len(self.files)

        def __getitem__(self, number: int) -> Any:
            with h5py.File(self.files[number]) as file:
                return torch.from_numpy(file["mesh_pos"][:])

    (several,) = torch.utils.data.DataLoader(Worlds(), batch_size=WORLDS)
    assert several.shape == (WORLDS, *h5py.File(Worlds.files[0])["mesh_pos"].shape)
