"""Odd meshes that are accepted: the policies that their warnings state, in forces."""

from pathlib import Path

import numpy as np
import pytest

from balloon_warp.benchmarks.bad_meshes import CUBE, WARNED, fan_at_an_edge
from balloon_warp.scene import load_scene
from balloon_warp.simulator import Simulator
from balloon_warp.sweep.batch import run_batch

pytestmark = pytest.mark.physics

PRESSURE = {"kind": "pressure", "pressure": 12.0}


def simulator_of(content: bytes, folder: Path, device: str, **balloon: object) -> Simulator:
    """Return the simulator of a mesh alone: no gravity, and inflation as asked for."""
    path = folder / "mesh.obj"
    path.write_bytes(content)
    overrides = [("gravity", 0.0), *((f"balloon.{name}", value) for name, value in balloon.items())]
    return Simulator(load_scene(path, overrides), device)


def case(name: str) -> bytes:
    return next(case.content() for case in WARNED if case.name == name)


def move(simulator: Simulator, particle: int, to: tuple[float, float, float]) -> None:
    points = simulator.state.points.numpy().copy()
    points[0, particle] = to
    simulator.state.points.assign(points)


@pytest.mark.parametrize(("inflation", "pushed"), [({"k_normal": 3.0}, True), (PRESSURE, False)])
def test_a_face_without_area_is_inflated_once_it_opens(inflation: dict, pushed: bool, tmp_path: Path, device: str):
    """A corner of a zero-area face on the edge of the cube is a fin without any other face: the paper's inflation
    pushes it once it opens, and a pressure does not."""
    simulator = simulator_of(case("zero-area face"), tmp_path, device, inflation=inflation)
    assert np.abs(simulator.read_frame(net_forces=True).inflation_forces[0][8]).max() < 1e-6
    move(simulator, 8, (0.5, -0.2, 0.0))
    force = np.linalg.norm(simulator.read_frame(net_forces=True).inflation_forces[0][8])
    assert force > 0.1 if pushed else force == 0.0


def test_coincident_vertices_pull_only_once_they_part(tmp_path: Path, device: str):
    """Vertices 1 and 9, whose spring has no length, pull once they part."""
    simulator = simulator_of(
        case("coincident vertices"), tmp_path, device, weld=False, inflation={"k_normal": 0.0}, helium=0.0
    )
    at_rest = simulator.read_frame(net_forces=True)
    assert np.abs(at_rest.net_forces[0]).max() < 5e-5  # rounding: 2e-7 of 20 N, ten springs
    move(simulator, 8, (-0.1, 0.0, 0.0))
    force = simulator.read_frame(net_forces=True).net_forces[0][8]
    assert force[0] > 0.1  # back
    simulator.step()
    assert np.isfinite(simulator.read_frame().points[0]).all()


def test_each_face_of_a_crowded_edge_is_inflated_to_its_side(tmp_path: Path, device: str):
    """A corner away from the spine of an open book belongs to one page, and is pushed along that page's normal."""
    simulator = simulator_of(fan_at_an_edge(7), tmp_path, device, inflation=PRESSURE, fixed=[])
    frame = simulator.read_frame(net_forces=True)
    points, forces = frame.points[0].astype(np.float64), frame.inflation_forces[0].astype(np.float64)
    faces = simulator.model.shapes[0].mesh.face_vertex_indices.reshape(-1, 3)
    assert len(faces) == 7
    first, second, rim = points[faces[:, 0]], points[faces[:, 1]], points[faces[:, 2]]
    area_vectors = 0.5 * np.cross(second - first, rim - first)
    # A third of the pressure on a triangle is on each corner; float32 of a few newtons.
    np.testing.assert_allclose(forces[faces[:, 2]], 12.0 * area_vectors / 3.0, atol=1e-4)


def test_free_components_are_inflated_as_one_and_otherwise_apart(tmp_path: Path, device: str):
    """The paper's inflation is shared by area: a cube of two has half the push of one alone."""
    alone = (
        simulator_of(CUBE, tmp_path, device, inflation={"k_normal": 3.0})
        .read_frame(net_forces=True)
        .inflation_forces[0]
    )
    simulator = simulator_of(case("several components"), tmp_path, device, inflation={"k_normal": 3.0}, parts="free")
    both = simulator.read_frame(net_forces=True).inflation_forces[0]
    np.testing.assert_allclose(both, 0.5 * np.concatenate([alone, alone]), atol=1e-4)
    pairs = simulator.model.shapes[0].springs.pairs
    assert ((pairs < 8).all(axis=1) | (pairs >= 8).all(axis=1)).all()


def test_a_mesh_by_itself_is_held_at_its_open_border(tmp_path: Path, device: str):
    """A mesh by itself is pinned at its open border, and inflated."""
    simulator = simulator_of(case("open border"), tmp_path, device, inflation={"k_normal": 3.0})
    start = simulator.read_frame().points[0]
    for _ in range(5):
        simulator.step()
    moved = np.linalg.norm(simulator.read_frame().points[0] - start, axis=1)
    border = [0, 1, 4, 5]  # of the face that is left out
    assert moved[border].max() == 0.0
    assert np.delete(moved, border).min() > 1e-3


@pytest.mark.parametrize("schedule", ["gather", "lanes", "octets", "block"])
def test_schedules_move_odd_meshes_alike(schedule: str, tmp_path: Path, device: str):
    """Schedules agree with `scatter` on odd meshes; the hub has more particles than a block takes."""
    if device != "cpu" and schedule in ("octets", "lanes"):
        pytest.skip("simulates on the CPU")
    path = tmp_path / "mesh.obj"
    for odd in WARNED:
        if odd.name == "a hub of 5,000 quads":
            continue
        path.write_bytes(odd.content())
        # In free air: whether a particle stands on the ground in a substep hangs on rounding, and so how far it slides.
        free = [("gravity", 0.0), ("ground.height", -9.0), ("balloon.fixed", [])]
        overrides = [*free, ("balloon.inflation.k_normal", 3.0), *odd.overrides]
        simulators = [Simulator(load_scene(path, overrides), device, schedule=name) for name in ("scatter", schedule)]
        start = simulators[0].read_frame().points[0]
        if odd.name in ("not orientable", "an edge of 100 faces"):
            # Several faces are equally near to a particle, which is inflated by one of them: rounding would choose.
            start = start + np.random.default_rng(1).uniform(-0.05, 0.05, start.shape).astype(np.float32)
        for simulator in simulators:
            simulator.state.points.assign(start[None])
            for _ in range(5):
                simulator.step()
        expected, found = (simulator.read_frame().points[0] for simulator in simulators)
        assert np.abs(expected - start).max() > 1e-3, odd.name
        # Sums in another order: float32 of coordinates of some meters, over a few dozen substeps.
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-5, err_msg=odd.name)


def test_a_spring_without_length_is_of_no_stretch_in_a_table(tmp_path: Path, device: str):
    """A spring of zero rest length has no stretch in the table, and leaves its world healthy."""
    (tmp_path / "mesh.obj").write_bytes(case("coincident vertices"))
    overrides = [("frames", 4), ("balloon.inflation.k_normal", 3.0), ("balloon.fixed", []), ("balloon.weld", False)]
    scene = load_scene(tmp_path / "mesh.obj", overrides)
    summary = run_batch(scene, tmp_path / "out", 2, {"gravity": [0.0, 9.0]}, device=device)
    assert summary.unhealthy_worlds == 0
    with np.load(tmp_path / "out" / "table.npz") as table:
        stretch = table["largest_stretch"]
    assert ((stretch > 0.9) & (stretch < 10.0)).all()
