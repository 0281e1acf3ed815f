"""Meshes from the wild: refused, accepted or accepted with a warning, and the policies of warnings in forces."""

import subprocess
import sys
import tracemalloc
from pathlib import Path
from unittest.mock import Mock

import numpy as np
import pytest
from commands import status_of
from trajectories import stepped

from balloon_warp import InputError, Simulator, build_springs, inspect_mesh, load_mesh, load_scene, run_batch
from balloon_warp.benchmarks.bad_meshes import ACCEPTED, CUBE, GAS, REFUSED, WARNED, MeshCase, fan_at_an_edge, hub
from balloon_warp.mesh.seams import welded
from balloon_warp.model import plan_model
from balloon_warp.scene.load import mesh_balloon


def written(case: MeshCase, folder: Path) -> Path:
    path = folder / "mesh.obj"
    path.write_bytes(case.content())
    return path


NAMED = {case.name: case for case in (*REFUSED, *ACCEPTED, *WARNED)}


def each(cases: list[MeshCase]) -> pytest.MarkDecorator:
    """Return a mark that starts a test for each case."""
    return pytest.mark.parametrize("case", cases, ids=[case.name for case in cases])


WITHOUT_A_BALLOON = ["all vertices at one place", "1e6 from the origin", "a scale of 1e-18", "a scale of 1e18"]
"""meshes that are reported on all the same"""


@each(REFUSED)
def test_refused_in_a_sentence(case: MeshCase, tmp_path: Path, capsys) -> None:
    path = written(case, tmp_path)
    sets = [f"--set={place}={value}" for place, value in case.overrides]
    for command in (["run", "-o", str(tmp_path / "out.usdc")], ["inspect"]):
        status = status_of(*command, str(path), *sets)
        out, err = capsys.readouterr()
        reported = command == ["inspect"] and (case.name in WITHOUT_A_BALLOON or GAS[0] in case.overrides)
        assert (status, "vertices" in out) == (2, reported)
        assert reported or not out
        (sentence,) = [line for line in err.splitlines() if line.strip()]
        assert sentence.startswith(f"error: {path if not case.overrides else 'mesh'}")
        assert case.says in sentence
        assert len(sentence) < 300 + len(str(path))
        assert list(tmp_path.iterdir()) == [path]


@each(ACCEPTED)
def test_accepted_without_fuss(case: MeshCase, tmp_path: Path) -> None:
    (tmp_path / "plain.obj").write_bytes(CUBE)
    plain, mesh = load_mesh(tmp_path / "plain.obj"), load_mesh(written(case, tmp_path))
    np.testing.assert_array_equal(mesh.points, plain.points)
    np.testing.assert_array_equal(mesh.face_vertex_indices, plain.face_vertex_indices)
    assert plan_model(load_scene(tmp_path / "mesh.obj")).shapes[0].mesh.warnings == ()


@pytest.mark.full
@each(WARNED)
def test_accepted_with_a_warning(case: MeshCase, tmp_path: Path) -> None:
    path = written(case, tmp_path)
    simulator = Simulator(load_scene(path, case.overrides), device="cpu")
    warnings = simulator.model.shapes[0].mesh.warnings
    assert [warning for warning in warnings if warning.startswith(case.says)]
    simulator.step()
    assert np.isfinite(simulator.read_frame().points[0]).all()
    treatment = mesh_balloon(path, case.overrides).treatment
    assert inspect_mesh(load_mesh(path), treatment=treatment).warnings == list(warnings)


COMMANDS = {
    "run": ["run", "--set=frames=2", "-o", "out.usdc"],
    "batch": ["batch", "--worlds", "2", "--vary", "gravity=1:9", "--set=frames=2", "-o", "out"],
    "view": ["view"],
}


@pytest.mark.full
@pytest.mark.parametrize("command", COMMANDS)
@pytest.mark.parametrize(
    ("name", "words", "said"),
    [
        ("duplicate face", [], "1 face has the corners of an earlier face; it is face 7, counting from 1. Repeated"),
        ("seams", ["--weld"], "16 vertices that lay exactly on others have been welded to them: they keep their"),
        ("seams", [], "16 vertices along seams, exactly on others, have been welded to them: they keep their"),
    ],
)
def test_commands_warn_on_standard_error(
    command: str, name: str, words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys
) -> None:
    if command == "view":
        pytest.importorskip("viser", reason="needs the extra `view`")
        page, start = "balloon_warp.studio.page.page.Page", Mock(side_effect=KeyboardInterrupt)
        monkeypatch.setattr(page, lambda session, *_, **__: Mock(session=session, start=start))
    written(NAMED[name], tmp_path)
    monkeypatch.chdir(tmp_path)
    assert not status_of(*COMMANDS[command], "mesh.obj", *words, "--device", "cpu")
    notes = ("note: mesh.obj inflates above a floor. Unit unknown", "note: auto pressure ", "note: mesh is coarse")
    (warning,) = [line for line in capsys.readouterr().err.splitlines() if not line.startswith(notes)]
    assert warning.startswith(f"warning: mesh: {said}")


SOUND_ONCE_REPAIRED = ["repeated corner", "duplicate face", "duplicate face, wound the other way", "mixed winding"]


@pytest.mark.full
@pytest.mark.parametrize("name", [*SOUND_ONCE_REPAIRED, "inward winding"])
@pytest.mark.parametrize("inflation", [{"k_normal": 3.0}, {"kind": "pressure", "pressure": 40.0}])
def test_a_repaired_mesh_moves_as_the_sound_one(name: str, inflation: dict, tmp_path: Path, device: str) -> None:
    (tmp_path / "plain.obj").write_bytes(CUBE)
    overrides = {"balloon.inflation": inflation, "frames": 3}
    sound, repaired = (
        [frame.points[0] for frame in Simulator(load_scene(path, overrides), device=device).run()]
        for path in (tmp_path / "plain.obj", written(NAMED[name], tmp_path))
    )
    # Where faces are turned, their corners are summed in another order: float32 of coordinates of 1 m.
    np.testing.assert_allclose(repaired, sound, rtol=0.0, atol=2e-6)
    assert np.ptp(np.asarray(sound)[:, 7], axis=0).max() > 1e-3  # it moves at all


def test_unused_vertices_have_no_mass_and_stay(tmp_path: Path) -> None:
    simulator = Simulator(load_scene(written(NAMED["unused vertices"], tmp_path)), device="cpu")
    (shape,) = simulator.model.shapes
    # Of an even skin: in proportion to sums of springs, in another order at each corner.
    assert shape.mass_share.tolist() == [*[pytest.approx(0.125, rel=1e-12)] * 8, 0.0, 0.0]
    assert stepped(simulator, 5).read_frame().points[0][8:].tolist() == [[5, 5, 5], [6, 6, 6]]


def test_welding_gives_the_springs_of_the_whole_mesh(tmp_path: Path) -> None:
    (tmp_path / "plain.obj").write_bytes(CUBE)
    mesh = welded(load_mesh(written(NAMED["welded seams"], tmp_path)))
    assert len(mesh.points) == 24  # vertices keep their numbers
    ends = []
    for each_mesh in (mesh, load_mesh(tmp_path / "plain.obj")):
        springs = build_springs(each_mesh)
        assert springs.count == 24
        ends.append({frozenset(map(tuple, each_mesh.points[pair].tolist())) for pair in springs.pairs})
    assert ends[0] == ends[1]


def test_a_hub_takes_memory_in_proportion(tmp_path: Path) -> None:
    (tmp_path / "mesh.obj").write_bytes(hub())
    mesh = load_mesh(tmp_path / "mesh.obj")
    tracemalloc.start()
    springs = build_springs(mesh)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert springs.count < 10 * mesh.vertex_count
    assert peak < 64 * 2**20  # all pairs of the hub's 5,000 neighbors would take 200 MB


def test_a_huge_file_is_refused_unread(tmp_path: Path) -> None:
    with (tmp_path / "huge.obj").open("wb") as file:
        file.truncate(2**31)
    with pytest.raises(InputError, match=r"huge\.obj: has 2,147,483,648 bytes; expected at most 1,073,741,824"):
        load_mesh(tmp_path / "huge.obj")


FILES_BESIDE = {
    "mesh.obj": (b"mtllib beside.mtl\nvt 0 0\n" + CUBE + b"usemtl a\nf 1/1 2/1 3/1\n", ["beside.mtl", "beside.png"]),
    "unused.obj": (b"mtllib beside.mtl\n" + CUBE, []),
    "mesh.ply": (
        b"ply\nformat ascii 1.0\ncomment TextureFile beside.png\nelement vertex 3\nproperty float x\n"
        b"property float y\nproperty float z\nproperty float s\nproperty float t\nelement face 1\n"
        b"property list uchar int vertex_indices\nend_header\n0 0 0 0 0\n1 0 0 1 0\n0 1 0 0 1\n3 0 1 2\n",
        [],
    ),
}
"""meshes, and the files that they have opened beside them: the materials and the base textures that are used"""


@pytest.mark.full
@pytest.mark.parametrize("name", FILES_BESIDE)
def test_only_used_materials_and_base_textures_are_opened(name: str, tmp_path: Path) -> None:
    content, others = FILES_BESIDE[name]
    (tmp_path / name).write_bytes(content)
    materials = "newmtl a\nmap_Kd beside.png\nmap_Bump other.png\nnewmtl b\nmap_Kd other.png\n"
    (tmp_path / "beside.mtl").write_text(materials)
    for image in ("other.png", "beside.png"):
        (tmp_path / image).write_bytes(b"no picture")
    program = (
        "import sys; from pathlib import Path; from balloon_warp.mesh.load import load_mesh\n"
        "def report(event, arguments):\n"
        "    if event == 'open' and str(arguments[0]).startswith(sys.argv[1]):\n"
        "        print(Path(arguments[0]).name)\n"
        "sys.addaudithook(report)\n"
        "load_mesh(sys.argv[1] + '/' + sys.argv[2])"
    )
    arguments = [sys.executable, "-c", program, str(tmp_path), name]
    result = subprocess.run(arguments, capture_output=True, text=True, timeout=60)
    assert (result.stdout.split(), result.stderr) == ([name, *others], "")


PRESSURE = {"kind": "pressure", "pressure": 12.0}


def simulator_of(content: bytes, folder: Path, device: str, **balloon: object) -> Simulator:
    """Return the simulator of a mesh alone: no gravity, and inflation as asked for."""
    path = folder / "mesh.obj"
    path.write_bytes(content)
    overrides = [("gravity", 0.0), *((f"balloon.{name}", value) for name, value in balloon.items())]
    return Simulator(load_scene(path, overrides), device)


def case(name: str) -> bytes:
    return NAMED[name].content()


def move(simulator: Simulator, particle: int, to: tuple[float, float, float]) -> None:
    points = simulator.state.points.numpy().copy()
    points[0, particle] = to
    simulator.state.points.assign(points)


@pytest.mark.full
@pytest.mark.physics
@pytest.mark.parametrize(("inflation", "pushed"), [({"k_normal": 3.0}, True), (PRESSURE, False)])
def test_a_face_without_area_is_inflated_once_it_opens(inflation: dict, pushed: bool, tmp_path: Path, device: str):
    """A corner of a zero-area face on the edge of the cube is a fin without any other face: the paper's inflation
    pushes it once it opens, and a pressure does not."""
    simulator = simulator_of(case("zero-area face"), tmp_path, device, inflation=inflation)
    assert np.abs(simulator.read_frame(net_forces=True).inflation_forces[0][8]).max() < 1e-6
    move(simulator, 8, (0.5, -0.2, 0.0))
    force = np.linalg.norm(simulator.read_frame(net_forces=True).inflation_forces[0][8])
    assert force > 0.1 if pushed else force == 0.0


@pytest.mark.full
@pytest.mark.physics
def test_coincident_vertices_pull_only_once_they_part(tmp_path: Path, device: str):
    limp = {"weld": False, "inflation": {"k_normal": 0.0}, "helium": 0.0}
    simulator = simulator_of(case("coincident vertices"), tmp_path, device, **limp)
    at_rest = simulator.read_frame(net_forces=True)
    assert np.abs(at_rest.net_forces[0]).max() < 5e-5  # rounding: 2e-7 of 20 N, ten springs
    move(simulator, 8, (-0.1, 0.0, 0.0))
    force = simulator.read_frame(net_forces=True).net_forces[0][8]
    assert force[0] > 0.1  # back
    simulator.step()
    assert np.isfinite(simulator.read_frame().points[0]).all()


@pytest.mark.full
@pytest.mark.physics
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


@pytest.mark.physics
def test_free_components_are_inflated_as_one_and_otherwise_apart(tmp_path: Path, device: str):
    """The paper's inflation is shared by area: a cube of two has half the push of one alone."""
    simulator = simulator_of(CUBE, tmp_path, device, inflation={"k_normal": 3.0})
    alone = simulator.read_frame(net_forces=True).inflation_forces[0]
    simulator = simulator_of(case("several components"), tmp_path, device, inflation={"k_normal": 3.0}, parts="free")
    both = simulator.read_frame(net_forces=True).inflation_forces[0]
    np.testing.assert_allclose(both, 0.5 * np.concatenate([alone, alone]), atol=1e-4)
    pairs = simulator.model.shapes[0].springs.pairs
    assert ((pairs < 8).all(axis=1) | (pairs >= 8).all(axis=1)).all()


@pytest.mark.physics
def test_a_mesh_by_itself_is_held_at_its_open_border(tmp_path: Path, device: str):
    simulator = simulator_of(case("open border"), tmp_path, device, inflation={"k_normal": 3.0})
    start = simulator.read_frame().points[0]
    moved = np.linalg.norm(stepped(simulator, 5).read_frame().points[0] - start, axis=1)
    border = [0, 1, 4, 5]  # of the face that is left out
    assert moved[border].max() == 0.0
    assert np.delete(moved, border).min() > 1e-3


@pytest.mark.full
@pytest.mark.physics
def test_schedules_move_odd_meshes_alike(schedule: str, tmp_path: Path, device: str):
    """Schedules agree with `scatter` on odd meshes; the hub has more particles than a block takes."""
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
        expected, found = (stepped(simulator, 5).read_frame().points[0] for simulator in simulators)
        assert np.abs(expected - start).max() > 1e-3, odd.name
        # Sums in another order: float32 of coordinates of some meters, over a few dozen substeps.
        np.testing.assert_allclose(found, expected, rtol=0.0, atol=2e-5, err_msg=odd.name)


@pytest.mark.physics
def test_a_spring_without_length_is_of_no_stretch_in_a_table(tmp_path: Path, device: str):
    (tmp_path / "mesh.obj").write_bytes(case("coincident vertices"))
    overrides = [("frames", 4), ("balloon.inflation.k_normal", 3.0), ("balloon.fixed", []), ("balloon.weld", False)]
    scene = load_scene(tmp_path / "mesh.obj", overrides)
    summary = run_batch(scene, tmp_path / "out", 2, {"gravity": [0.0, 9.0]}, device=device)
    assert summary.unhealthy_worlds == 0
    with np.load(tmp_path / "out" / "table.npz") as table:
        stretch = table["largest_stretch"]
    assert ((stretch > 0.9) & (stretch < 10.0)).all()
