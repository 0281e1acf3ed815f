"""Worlds that differ, by which values, how they are divided into shares, and their trajectories."""

from pathlib import Path

import numpy as np
import pytest
import warp as wp
from meshes import cube, mesh_of, quad_sphere
from work import lines_executed

from balloon_warp import BlowUpError, InputError, Simulator, load_scene, simulate
from balloon_warp.batch.batch import Range, parse_export, parse_vary, spread
from balloon_warp.batch.recorder import Recorder, plan_groups
from balloon_warp.farm import cluster
from balloon_warp.farm.cluster import cut_into_shares
from balloon_warp.model import ModelPlan, plan_model
from balloon_warp.model.timeline import scene_to_vary
from balloon_warp.scene import Balloon, Body, Ground, Inflation, Scene, Sphere, Stiffness, String
from balloon_warp.scene.load import override_scene

NO_SPRINGS = Stiffness(structural=0.0, shear=0.0, flexion=0.0)
FREE_CUBE = Balloon(mesh=cube(), mass=0.05, stiffness=NO_SPRINGS, inflation=Inflation(k_normal=0.0), damping=0.0)
RAMPED = Balloon(mesh=quad_sphere(3), helium=3.0, inflation=Inflation(k_normal=[(0.0, 0.5), (0.05, 1.0), (0.1, 2.0)]))
LATE = Balloon(mesh=cube(), position=(3.0, 0.0, 0.0), inflation=Inflation(k_normal=[(0.0, 0.1), (0.05, 0.4)]))
FALLING = Sphere(position=(-3.0, -0.75, 0.0), velocity=(0.0, -1.0, 0.0), radius=0.3)
EVERYTHING = Scene(
    balloon=[RAMPED, LATE],
    sphere=[Sphere(position=(0.3, 1.1, 0.1), radius=0.4), Sphere(position=(3.5, 1.2, 0.5), radius=0.3), FALLING],
    string=[String(anchor=(0.0, -2.0, 0.0), length=0.5)],
    ground=Ground(height=-1.1),
    **{"frames": 4, "frames_per_second": 30, "substeps": 40},
)
"""a scene where every varied value matters: a sphere on the balloon, a taut string, ramped inflation"""


def end_state(simulator: Simulator, world: int) -> np.ndarray:
    frame = simulator.read_frame(world)
    moving = [*frame.points, *frame.velocities, frame.sphere_positions, frame.sphere_velocities]
    return np.concatenate([part.ravel() for part in moving])


def run(simulator: Simulator) -> Simulator:
    for _ in range(simulator.model.scene.frames):
        simulator.step()
    return simulator


def end_alone(*overrides: tuple[str, float]) -> np.ndarray:
    return end_state(run(Simulator(override_scene(EVERYTHING, overrides), "cpu", schedule="lanes")), 0)


def test_a_recorder_of_places_and_turns_writes_within_its_arrays(monkeypatch: pytest.MonkeyPatch):
    """Both are picked in one graph: what stands behind the places stays, from the first frame on."""
    scene = Scene(balloon=[FREE_CUBE], body=[Body(size=(0.1, 0.1, 0.1), position=(3.0, 0.0, 0.0))], frames=2)
    simulator = Simulator(scene, "cpu", 2)
    shape = (2, simulator.model.particle_count)
    for _ in range(2):  # once all kernels are compiled, too
        room = wp.full(3 * shape[0] * shape[1] + 8, 7.25, dtype=float, device="cpu")
        recorder = Recorder(simulator, np.array([0, 1]))
        picked = wp.array(ptr=room.ptr, shape=shape, dtype=wp.vec3, device="cpu")
        monkeypatch.setattr(recorder, "_points", picked)
        for _ in recorder.run():
            np.testing.assert_array_equal(room.numpy()[-8:], 7.25)
        np.testing.assert_array_equal(picked.numpy(), simulator.state.points.numpy())
        simulator.reset()


@pytest.mark.full
@pytest.mark.parametrize(
    ("path", "values"),
    [
        ("balloon.1.mass", (0.08, 0.2)),
        ("balloon.inflation.k_normal", (0.0, 3.0)),
        ("balloon.0.inflation.k_normal.1.1", (0.2, 3.0)),
        ("balloon.0.inflation.k_normal.2.1", (0.2, 3.0)),
        ("balloon.1.inflation.k_normal.1.1", (0.2, 3.0)),
        ("sphere.1.position.1", (1.1, 2.0)),
        ("sphere.0.velocity.0", (-1.0, 1.0)),
        ("string.anchor.1", (-2.0, -1.7)),
        ("balloon.position.0", (0.013, 0.31)),
        ("balloon.1.position.2", (-0.2, 0.07)),
        ("ground.height", (-1.1, -0.91)),
    ],
)
def test_a_world_of_a_batch_is_the_overridden_scene_alone(path: str, values: tuple[float, float]):
    """A world is bit-identical to the overridden scene on the CPU, where the order of the sums is fixed.

    These paths lead to one of several, to keyframes and to places; test_model_parameters.py has every row, and
    test_schedules.py what schedules make of them."""
    batch = run(Simulator(EVERYTHING, "cpu", 2, {path: np.array(values)}, schedule="lanes"))
    for world, value in enumerate(values):
        np.testing.assert_array_equal(end_state(batch, world), end_alone((path, value)))
    assert np.abs(end_state(batch, 0) - end_state(batch, 1)).max() > 1e-4


def test_strings_of_no_said_length_reach_from_each_worlds_anchor_to_its_balloon():
    strings = [String(anchor=(0.0, -2.0, 0.0)), String(anchor=(1, 0, 0), length=0.5)]
    scene = EVERYTHING.model_copy(update={"string": strings})
    heights, anchors = np.array([0.0, 0.4, 1.0]), np.array([0.0, 0.3, 0.0])
    plan = plan_model(scene, 3, {"balloon.0.position.1": heights, "string.0.anchor.0": anchors})
    lengths = plan.parameters["string_length"]
    for world in range(3):
        held = quad_sphere(3).points[plan.held[0]] + [0.0, heights[world], 0.0]
        assert lengths[world, 0] == pytest.approx(np.linalg.norm(held - [anchors[world], -2.0, 0.0]), rel=1e-12)
    np.testing.assert_array_equal(lengths[:, 1], 0.5)


@pytest.mark.parametrize(("field", "kind"), [("k_normal", "normal_force"), ("litres", "gas"), ("pressure", "pressure")])
def test_a_balloon_that_leaves_it_open_has_the_inflation_that_differs(field: str, kind: str):
    for path in (f"balloon.inflation.{field}", f"balloon.0.inflation.{field}"):
        varied = scene_to_vary(Scene(balloon=[Balloon(mesh=cube())]), {path: [1.0, 2.0]})
        assert varied.balloon[0].inflation.kind == kind


@pytest.mark.parametrize("particle", ["highest", "lowest"])
def test_a_string_holds_the_same_particle_in_all_worlds(particle: str):
    """The next tip of an octahedron on its tip is as high once it has turned by 45 degrees."""
    faces = [[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]]
    tied = String(anchor=(0.0, 3.0, 0.0), particle=particle)
    scene = Scene(balloon=[Balloon(mesh=mesh_of([*np.eye(3), *-np.eye(3)], faces))], string=[tied])
    plan_model(scene, 2, {"balloon.rotation.2": [0.0, 40.0]})
    with pytest.raises(InputError, match=f"in world 1 string 0 would hold another particle, which is the {particle}"):
        plan_model(scene, 2, {"balloon.rotation.2": [0.0, 50.0]})


@pytest.mark.full
def test_overrides_keep_all_else_and_the_last_named_wins():
    vary = {"balloon.mass": np.array([0.1, 0.2]), "balloon.0.mass": np.array([0.15, 0.3]), "gravity": [1.0, 2.0]}
    batch = run(Simulator(EVERYTHING, "cpu", 2, vary, schedule="lanes"))
    alone = end_alone(("balloon.mass", 0.2), ("balloon.0.mass", 0.3), ("gravity", 2.0))
    np.testing.assert_array_equal(end_state(batch, 1), alone)
    changed = override_scene(EVERYTHING, [("sphere.0.mass", 7.0)])
    assert changed.sphere[0].mass == 7.0
    assert changed.balloon[0].mesh is EVERYTHING.balloon[0].mesh
    back = override_scene(changed, [("sphere.0.mass", EVERYTHING.sphere[0].mass)])
    assert back.model_dump(exclude={"balloon"}) == EVERYTHING.model_dump(exclude={"balloon"})


@pytest.mark.parametrize(
    ("vary", "complaint"),
    [
        ({"balloon.mass": [1.0, 1.0, -1.0, 1.0]}, r"balloon\.0\.mass: must be .* 0 \(got -1\.0\), in world 2$"),
        ({"sphere.1.radius": [1.0, 0.0, 1.0, 1.0]}, r"sphere\.1\.radius: must be greater than 0 .* in world 1$"),
        ({"gravity": [1.0, 1.0, 1.0, np.nan]}, r"gravity: must be a finite number \(got nan\), in world 3$"),
        ({"balloon.mass": [1.0, 2.0]}, r"balloon\.mass: expected a value for each of 4 worlds \(got shape \(2,\)\)$"),
        ({"balloon.mass": ["a", "b", "c", "d"]}, r"balloon\.mass: expected a number for each world \(got \['a'"),
        ({"balloon.mas": [1.0] * 4}, r"balloon\.0\.mas: unknown field; did you mean mass\?$"),
        ({"sphere.5.mass": [1.0] * 4}, r"sphere\.5\.mass: no sphere 5, the scene has 3, counted from 0$"),
        ({"frames": [1] * 4}, r"frames: cannot differ .*; what can: gravity, corr.*, .*ground.*string\.length"),
        ({"balloon.1.position.2": [0, 1, 0, 1e6]}, r"mesh: is 1 m across and 1e\+06 m from the origin, too far"),
        ({"water.level": [0.0] * 4}, r"water\.level: cannot differ between worlds, the scene has no water$"),
    ],
)
def test_a_wrong_value_is_told_in_a_sentence(vary: dict, complaint: str):
    with pytest.raises(InputError, match=f"^{complaint}"):
        plan_model(EVERYTHING, 4, vary)


def test_many_worlds_are_planned_without_a_loop_over_them():
    draw = np.random.default_rng(0).uniform(0.1, 1.0, 65_536)
    paths = ["balloon.mass", "balloon.stiffness.shear", "balloon.inflation.k_normal", "sphere.0.position.1"]
    scene = EVERYTHING.model_copy(update={"substeps": "auto"})

    def plan_worlds(count: int) -> ModelPlan:
        return plan_model(scene, count, dict.fromkeys(paths, draw[:count]))

    plan = plan_worlds(len(draw))
    assert lines_executed(lambda: plan_worlds(len(draw))) <= 1.1 * lines_executed(lambda: plan_worlds(16))
    np.testing.assert_array_equal(plan.parameters["mass"], np.stack([draw, draw], axis=1))
    assert plan.parameters["helium"].shape == (1, 2)


@pytest.mark.parametrize("world", [-1, 2])
def test_a_world_that_is_not_there_gets_a_sentence(world: int):
    simulator = Simulator(Scene(balloon=[Balloon(mesh=cube())]), "cpu", world_count=2)
    with pytest.raises(InputError, match=rf"^world: no world {world}; expected 0 to 1$"):
        simulator.read_frame(world)


BALL = Scene(frames=3, substeps=8, balloon=[Balloon(mesh=quad_sphere(2), mass=1.0)])
OF_MODELS = {
    "balloon.stiffness.variation": [0.0, 0.5, 0.5, 0.5],
    "balloon.0.stiffness.seed": np.array([0, 1, 2, 1]),
    "balloon.scale": [1.0, 1.0, 1.0, 2.0],
    "gravity": [1.0, 2.0, 3.0, 4.0],
}


def test_each_world_is_as_it_is_alone():
    found = simulate(BALL, world_count=4, vary=OF_MODELS, device="cpu", schedule="gather")
    for world in range(4):
        own = {path: values[world] for path, values in OF_MODELS.items()}
        alone = simulate(load_scene(BALL, own), device="cpu", schedule="gather")
        np.testing.assert_array_equal(found.points[0][world], alone.points[0])
    assert len({points.tobytes() for points in found.points[0][:, -1]}) == 4


def test_worlds_of_one_model_stay_together():
    vary = {"balloon.stiffness.seed": [3, 5, 3, 3], "gravity": [1.0, 2.0, 3.0, 4.0]}
    groups = plan_groups(BALL, 4, vary)
    assert [group.worlds.tolist() for group in groups] == [[0, 2, 3], [1]]
    assert groups[0].plan.parameters["gravity"].tolist() == [1.0, 3.0, 4.0]


def test_what_is_wrong_is_told_with_its_world():
    for path, values, sentence in [
        ("balloon.stiffness.variation", [1.0, 2.0], r"balloon\.0\.stiffness\.variation: must be .* 1 \(got 2\.0\), in"),
        ("balloon.scale", [1.0], r"balloon\.scale: expected a number for each of 2 worlds \(got 1\)$"),
    ]:
        with pytest.raises(InputError, match=f"^{sentence}"):
            plan_groups(BALL, 2, {path: values})
    with pytest.raises(InputError, match=r"^balloon\.scale: needs a model for each world; batches and `simulate`"):
        Simulator(BALL, "cpu", 2, {"balloon.scale": [1.0, 2.0]})


@pytest.mark.parametrize(
    ("text", "parsed"),
    [
        ("balloon.inflation.k_normal=0:8", ("balloon.inflation.k_normal", Range(0.0, 8.0))),
        (" sphere.0.mass = 1, 10,1e2", ("sphere.0.mass", [1.0, 10.0, 100.0])),
        ("gravity=-9.81", ("gravity", [-9.81])),
        ("gravity=-3:-1.5", ("gravity", Range(-3.0, -1.5))),
    ],
)
def test_ranges_and_lists_are_read(text: str, parsed: tuple):
    assert parse_vary(text) == parsed


@pytest.mark.parametrize(
    "text",
    [
        *("gravity", "gravity=", "=1:2", "a..b=1", "gravity=1:", "gravity=2:1", "gravity=1:1"),
        *("gravity=a", "gravity=1:2:3", "gravity=1,,2", "gravity=nan", "gravity=0:inf"),
    ],
)
def test_what_is_neither_is_told(text: str):
    with pytest.raises(InputError, match=r"--vary .*: expected PATH=LOW:HIGH with LOW below HIGH, or PATH=NUMBER,"):
        parse_vary(text)


def test_meshes_are_sought_here_and_beside_the_scene(tmp_path, monkeypatch):
    (here := tmp_path / "here").mkdir()
    (here / "a.obj").touch()
    monkeypatch.chdir(here)
    _, meshes = parse_vary("balloon.mesh=a.obj,b.obj", str(tmp_path / "scene.toml"))
    assert meshes == ["a.obj", str(tmp_path / "b.obj")]
    _, bundled = parse_vary("balloon.mesh=turtle.obj", "squirrel_inflate")
    assert isinstance(bundled, list)
    assert Path(str(bundled[0])).is_file()


def test_lists_are_cycled_and_a_grid_is_even_with_its_ends_and_the_first_range_fastest():
    np.testing.assert_array_equal(spread({"a": [1.0, 10.0, 100.0]}, 5)["a"], [1.0, 10.0, 100.0, 1.0, 10.0])
    grid = spread({"a": Range(0.0, 2.0), "b": Range(5.0, 6.0), "c": [1.0, 2.0]}, 6, grid=True)
    np.testing.assert_equal(grid, {"a": [0, 1, 2, 0, 1, 2], "b": [5, 5, 5, 6, 6, 6], "c": [1, 2, 1, 2, 1, 2]})


def test_samples_are_uniform_and_go_by_seed_path_and_world():
    """Mean and spread of 10,000 samples are within four standard errors, and depend on no other path's samples."""
    samples = spread({"a": Range(2.0, 8.0)}, 10_000, seed=3)["a"]
    assert 2.0 <= np.min(samples) < np.max(samples) < 8.0
    assert np.mean(samples) == pytest.approx(5.0, abs=4 * 6.0 / np.sqrt(12 * 10_000))
    assert np.var(samples) == pytest.approx(3.0, abs=4 * 9.0 * np.sqrt(1 / 180 / 10_000) * 4)
    fewer = spread({"b": Range(0.0, 1.0), "a": Range(2.0, 8.0)}, 10, seed=3)
    np.testing.assert_array_equal(fewer["a"], samples[:10])
    assert not np.array_equal(6.0 * np.array(fewer["b"]) + 2.0, fewer["a"])
    assert not np.array_equal(spread({"a": Range(2.0, 8.0)}, 10, seed=4)["a"], samples[:10])


@pytest.mark.parametrize(
    ("ranges", "worlds", "sides"),
    [(1, 7, [7]), (2, 4096, [64, 64]), (2, 10, [3, 3]), (2, 12, [4, 3]), (3, 65_536, [40, 40, 40]), (2, 1, [1, 1])],
)
def test_a_grid_has_about_as_many_points_on_each_range_as_fit(ranges: int, worlds: int, sides: list[int]):
    grid = spread({str(n): Range(0.0, 1.0) for n in range(ranges)}, worlds, grid=True)
    assert [len(np.unique(values)) for values in grid.values()] == sides
    points = np.stack([np.array(values) for values in grid.values()], axis=1)
    count = int(np.prod(sides))
    assert len(np.unique(points[:count], axis=0)) == count
    np.testing.assert_array_equal(points[count:], points[: worlds - count])


def test_exports_are_all_none_or_chosen_worlds():
    assert parse_export("all", 3) == [0, 1, 2]
    assert parse_export("none", 3) == []
    assert parse_export("5, 0,5", 6) == [0, 5]
    with pytest.raises(InputError, match=r"^export 0,6: no world 6, the batch has worlds 0 to 5$"):
        parse_export("0,6", 6)
    with pytest.raises(InputError, match=r"^export first: expected all, none, or worlds such as 0,5,9$"):
        parse_export("first", 6)


@pytest.mark.parametrize(
    ("worlds", "sizes"),
    [
        (1, [1]),
        (9, [5, 4]),
        (64, [8] * 8),
        (65, [13] * 5),  # more than eight times eight: the next power of two, 16, makes five shares
    ],
)
def test_the_cut_depends_on_the_batch_alone(worlds: int, sizes: list[int], monkeypatch):
    """The cut has at most eight shares of at least eight cubes; each has its own part of the varied values."""
    monkeypatch.setitem(cluster.GRAIN, "cpu", cluster.Grain(1, 64))
    monkeypatch.setattr(cluster, "SHARES", 8)
    mass = np.linspace(1.0, 0.01, worlds)
    groups = plan_groups(Scene(balloon=[Balloon(mesh=cube())]), worlds, {"balloon.mass": mass})
    cut = cut_into_shares(groups, "cpu")
    assert [share.plan.world_count for share in cut] == sizes
    np.testing.assert_array_equal(np.concatenate([share.worlds for share in cut]), np.arange(worlds))
    np.testing.assert_array_equal(np.concatenate([share.plan.parameters["mass"][:, 0] for share in cut]), mass)
    assert {len(share.plan.parameters["gravity"]) for share in cut} == {1}
    assert {share.plan.substeps for share in cut} == {groups[0].plan.substeps}  # that of the lightest world


def test_a_share_fills_the_lanes_of_a_cpu():
    groups = plan_groups(Scene(balloon=[Balloon(mesh=quad_sphere(20))]), 20, {"balloon.mass": np.full(20, 1.0)})
    assert groups[0].plan.particle_count > cluster.GRAIN["cpu"].particles
    assert [len(share.worlds) for share in cut_into_shares(groups, "cpu")] == [7, 7, 6]


@pytest.mark.parametrize(("frames", "count"), [(1, 2), (100, 4), (1000, 32)])
def test_a_share_is_worth_its_beginning(frames: int, count: int, monkeypatch):
    """A short batch is cut into fewer shares, as each has a start-up cost, which still fit into a small memory."""
    monkeypatch.setattr(cluster, "MOST_PARTICLES", 8 * 128)
    monkeypatch.setitem(cluster.GRAIN, "cuda", cluster.Grain(1, 8, 8 * 64 * 100 * 10))
    scene = Scene(balloon=[Balloon(mesh=cube())], frames=frames, substeps=10)
    assert len(cut_into_shares(plan_groups(scene, 256, {"balloon.mass": np.full(256, 100.0)}), "cuda")) == count


PAIR = [Balloon(mesh=cube()), Balloon(mesh=quad_sphere(3), position=(5.0, 0.0, 0.0))]
TWO = Scene(frames=5, frames_per_second=50.0, balloon=PAIR, sphere=[Sphere(position=(0.0, 4.0, 0.0))])


@pytest.mark.full
def test_arrays_hold_what_the_frames_hold():
    found = simulate(TWO, device="cpu")
    np.testing.assert_allclose(found.times, [0.0, 0.02, 0.04, 0.06, 0.08, 0.1], rtol=1e-12)
    assert [points.shape for points in found.points] == [(6, 8, 3), (6, 56, 3)]
    for frame in Simulator(TWO, "cpu").run():
        for name in ("points", "velocities"):
            np.testing.assert_equal([each[frame.number] for each in getattr(found, name)], list(getattr(frame, name)))
        for name in ("pressures", "gas_amounts", "sphere_positions", "sphere_velocities"):
            np.testing.assert_array_equal(getattr(found, name)[frame.number], getattr(frame, name))
        for name in ("volumes", "areas"):  # NumPy adds in an order that hangs on where the numbers lie
            np.testing.assert_allclose(getattr(found, name)[frame.number], getattr(frame, name), rtol=1e-14)
    assert repr(found) == "Trajectories(mesh of 8 particles, mesh of 56 particles; 6 frames, 0 to 0.1 s)"


@pytest.mark.full
def test_worlds_come_first_and_frames_may_be_left_out():
    """A sphere falls by g t^2 / 2 in each world's gravity, to the first order of the step: v is a step ahead."""
    gravity = np.array([1.0, 2.0, 9.81])
    found = simulate(TWO, {"frames": 6}, world_count=3, vary={"gravity": gravity}, every=3, device="cpu")
    np.testing.assert_allclose(found.times, [0.0, 0.06, 0.12])
    assert found.points[1].shape == (3, 3, 56, 3)
    assert found.volumes.shape == found.pressures.shape == (3, 3, 2)
    fallen = 4.0 - found.sphere_positions[:, :, 0, 1]
    substep = 0.02 / Simulator(TWO, "cpu").model.substeps
    exact = 0.5 * gravity[:, None] * found.times * (found.times + substep)
    np.testing.assert_allclose(fallen, exact, atol=2e-6)  # float32 at 4 m


@pytest.mark.full
def test_what_cannot_be_told_is_refused():
    with pytest.raises(InputError, match=r"^vary: meshes of different sizes need separate trajectories"):
        simulate(TWO, world_count=2, vary={"balloon.0.mesh": [cube(), quad_sphere(3)]}, device="cpu")
    with pytest.raises(InputError, match=r"^every: must be at least 1 \(got 0\)$"):
        simulate(TWO, every=0, device="cpu")
    with pytest.raises(InputError, match=r"^1 worlds do not fit: they need "):
        simulate(TWO, {"frames": 10**9}, device="cpu")
    with pytest.raises(BlowUpError):
        simulate(TWO, {"solver": "forward_euler", "substeps": 1, "balloon.mass": 1e-4, "frames": 60}, device="cpu")
