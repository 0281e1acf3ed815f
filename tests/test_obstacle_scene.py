"""Obstacles in scene files: round trip, and messages for wrong ones."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from meshes import cube, grid, quad_sphere

from balloon_warp import Balloon, InputError, Obstacle, PolygonMesh, Scene, Simulator, load_scene, run_batch
from balloon_warp.batch.batch import repeat_batch
from balloon_warp.mesh.obj import write_obj
from balloon_warp.model import plan_model
from balloon_warp.run.provenance import describe_simulation, hash_of_file, without_folders
from balloon_warp.scene.load import override_scene
from balloon_warp.scene.write import write_scene

MOTION = [(0.0, (0.0, 0.0, 0.0)), (0.5, (0.0, -1.0, 0.0), (0.0, 90.0, 0.0))]
INSIDE = r"^balloon\.0\.position: ball starts 0\.0\d+ m deep inside obstacle 0, a {}; expected it outside$"


def scene(folder: Path) -> Scene:
    """Return a file that names two mesh files beside it."""
    write_obj(folder / "ball.obj", quad_sphere(2))
    write_obj(folder / "tile.obj", cube())
    path = folder / "scene.toml"
    path.write_text(
        """
        [[balloon]]
        mesh = "ball.obj"
        [[obstacle]]
        mesh = "tile.obj"
        scale = 2.0
        position = [0.0, -4.0, 0.0]
        motion = [[0.0, [0.0, 0.0, 0.0]], [0.5, [0.0, -1.0, 0.0], [0.0, 90.0, 0.0]]]
        [[obstacle]]
        radius = 0.2
        position = [3.0, 0.0, 0.0]
        """
    )
    return load_scene(path)


def test_the_shape_is_that_of_the_fields(tmp_path: Path):
    tile, capsule = scene(tmp_path).obstacle
    assert (tile.shape, tile.mesh, tile.motion) == ("mesh", tmp_path / "tile.obj", MOTION)
    assert (capsule.shape, capsule.length) == ("capsule", 1.0)
    assert Obstacle().shape == "box"


def test_a_written_scene_has_the_same_obstacles(tmp_path: Path):
    before = scene(tmp_path)
    (tmp_path / "elsewhere").mkdir()
    (written,) = write_scene(before, tmp_path / "elsewhere" / "mine.toml")
    after = load_scene(written)
    assert Path(str(after.obstacle[0].mesh)).resolve() == before.obstacle[0].mesh
    there = [obstacle.model_copy(update={"mesh": None}) for obstacle in after.obstacle]
    assert there == [obstacle.model_copy(update={"mesh": None}) for obstacle in before.obstacle]


def test_overrides_keep_a_mesh_that_came_from_python():
    made = Scene(balloon=[Balloon(mesh=quad_sphere(2))], obstacle=[Obstacle(mesh=grid(2, 2), position=(0, -3, 0))])
    changed = override_scene(made, {"obstacle.0.friction": 0.1, "obstacle.position": (0.0, -2.0, 0.0)}.items())
    assert isinstance(changed.obstacle[0].mesh, PolygonMesh)
    np.testing.assert_array_equal(changed.obstacle[0].mesh.points, grid(2, 2).points)
    assert (changed.obstacle[0].friction, changed.obstacle[0].position) == (0.1, (0.0, -2.0, 0.0))


def test_what_is_said_of_a_run_and_a_batch_has_the_hashes_of_their_meshes(tmp_path: Path):
    made = scene(tmp_path)
    described = without_folders(describe_simulation(made, (), 10))
    assert described["files"]["obstacle.0.mesh"] == hash_of_file(tmp_path / "tile.obj")
    assert described["scene"]["obstacle"][0]["mesh"] == "tile.obj"
    short = made.model_copy(update={"frames": 1})
    run_batch(short, tmp_path / "out", 2, {"obstacle.1.friction": [0.1, 0.2]}, device="cpu", schedule="gather")
    write_obj(tmp_path / "tile.obj", grid(2, 2))
    with pytest.raises(InputError, match=r"tile\.obj: has changed since the batch"):
        repeat_batch(tmp_path / "out" / "manifest.json", tmp_path / "again")


NO_FACES = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"
MISTAKES = {
    'mesh = "none.obj"': r"none\.obj: has no faces \(no line begins with f\)$",
    'mesh = "nan.obj"': r"nan\.obj, line 2: coordinates must be finite and fit in 32-bit floats \(got nan 0\.0 0\.0\)$",
    'mesh = "point.obj"': r"point\.obj: all vertices coincide; expected a mesh with an extent$",
    'mesh = "tiles.obj"': r"tiles\.obj: no such file; did you mean .*tile\.obj",
    'shape = "mesh"': r'obstacle\.0\.mesh: is missing; shape = "mesh" needs a mesh file$',
    'shape = "ball"': r"obstacle\.0\.shape: must be 'box', 'capsule', 'plane' or 'mesh' \(got 'ball'\)$",
    "size = [1, 1, 1]\nradius = 0.2": r'obstacle\.0\.radius: needs shape = "capsule" \(got shape = "box"\)$',
    'shape = "plane"\nscale = 2.0': r'obstacle\.0\.scale: needs shape = "mesh" \(got shape = "plane"\)$',
    "friction = -0.1": r"obstacle\.0\.friction: must be greater than or equal to 0 \(got -0\.1\)$",
    "frition = 0.1": r"obstacle\.0\.frition: unknown field; did you mean friction\?$",
    "motion = [[0.5, [0, 0, 0]], [0.5, [0, 1, 0]]]": r"motion: keyframe times must increase \(got \[0\.5, 0\.5\]\)$",
    "motion = [[0.0, [0, 0, 0]], [1e9, [0, 1, 0]]]": r"motion: ends after 1e\+09 s; expected 16666\.7 s at most$",
    "motion = [[0.0, [0, 0, 0]], [0.1, [0, 0, 0], [0, 3600, 0]]]": (
        r"obstacle\.0\.motion: turns by 600 degrees in a frame; expected at most 90$"
    ),
}


@pytest.mark.parametrize("said", MISTAKES)
def test_a_mistake_gets_a_sentence(said: str, tmp_path: Path):
    scene(tmp_path)
    (tmp_path / "none.obj").write_text(NO_FACES)
    (tmp_path / "nan.obj").write_text(NO_FACES.replace("1", "nan") + "f 1 2 3\n")
    (tmp_path / "point.obj").write_text(NO_FACES.replace("1", "0") + "f 1 2 3\n")
    path = tmp_path / "wrong.toml"
    path.write_text(f'[[balloon]]\nmesh = "ball.obj"\n[[obstacle]]\nposition = [0, -9, 0]\n{said}\n')
    with pytest.raises(InputError, match=MISTAKES[said]):
        plan_model(load_scene(path))


def starts(obstacle: Obstacle, **fields) -> None:
    """Plan a ball of radius 0.5 at the origin beside an obstacle."""
    balloon = Balloon(mesh=quad_sphere(6, 0.5), name="ball")
    plan_model(Scene(**{"balloon": [balloon], "obstacle": [obstacle], **fields}))


@pytest.mark.full
@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize(
    ("fields", "touching", "direction", "kind"),
    [
        ({"size": (2.0, 0.4, 2.0)}, 0.7, (0.0, -1.0, 0.0), "box"),
        ({"size": (2.0, 0.4, 2.0), "rotation": (0.0, 0.0, 90.0)}, 0.7, (-1.0, 0.0, 0.0), "box"),
        ({"radius": 0.2}, 0.7, (1.0, 0.0, 0.0), "capsule"),
        ({"radius": 0.2, "length": 0.0}, 0.7, (0.0, 0.6, 0.8), "capsule"),
        ({"mesh": quad_sphere(12, 0.4)}, 0.9, (0.0, -1.0, 0.0), "mesh"),
        ({"radius": 0.2, "motion": [(0.0, (0.0, 5.0, 0.0))]}, 0.7, (0.0, -1.0, 0.0), None),
    ],
)
def test_a_balloon_that_starts_inside_an_obstacle_is_refused(fields, touching, direction, kind, up_axis: str):
    """A balloon inside an obstacle is refused; one in contact is not, nor one clear of it by its motion."""
    for gap, refused in ((0.0, False), (-0.05, kind is not None)):
        place = tuple((touching + gap) * np.array(direction))
        with pytest.raises(InputError, match=INSIDE.format(kind)) if refused else nullcontext():
            starts(Obstacle(position=place, **fields), up_axis=up_axis)


@pytest.mark.parametrize(("up_axis", "place"), [("Y", (7.0, -0.4, 3.0)), ("Z", (7.0, 3.0, -0.4))])
def test_a_balloon_that_starts_below_a_plane_is_refused(up_axis: str, place):
    with pytest.raises(InputError, match=r"ball starts 0\.1 m deep inside obstacle 0, floor; expected it outside"):
        starts(Obstacle(shape="plane", position=place, name="floor"), up_axis=up_axis)
    starts(Obstacle(shape="plane", position=tuple(1.25 * np.array(place))), up_axis=up_axis)


def test_sheets_and_fixed_particles_have_nothing_inside():
    starts(Obstacle(mesh=grid(2, 2), position=(-0.5, 0.0, 0.0)))
    held = Balloon(mesh=quad_sphere(3, 0.5), fixed=list(range(quad_sphere(3).vertex_count)))
    starts(Obstacle(), balloon=[held])


@pytest.mark.full
def test_a_mesh_that_winds_inward_is_a_room_and_holds_a_ball(device: str):
    walls = cube()
    room = replace(walls, points=4.0 * (walls.points - 0.5), face_vertex_indices=walls.face_vertex_indices[::-1].copy())
    ball = Balloon(mesh=quad_sphere(2, 0.3), velocity=(4.0, 1.0, 2.0), damping=0.0)
    simulator = Simulator(Scene(balloon=[ball], obstacle=[Obstacle(mesh=room)], frames=90), device)
    frames = list(simulator.run())
    assert max(np.abs(frame.points[0]).max() for frame in frames) < 2.0
    assert np.ptp(frames[-1].points[0], axis=0).max() > 0.3
    solid = replace(room, face_vertex_indices=walls.face_vertex_indices)
    with pytest.raises(InputError, match=r"starts .* deep inside obstacle 0"):
        plan_model(Scene(balloon=[ball], obstacle=[Obstacle(mesh=solid)]))


@pytest.mark.parametrize("size", [0.3, 3.0])
def test_a_start_is_refused_as_deep_as_its_deepest_particle(size: float):
    """Boxes smaller and larger than the ball, at any place, may have a hundredth of the smaller extent of it within."""
    ball, half, rng = quad_sphere(3, 0.5), 0.5 * np.array([1.0, 0.8, 1.2]) * size, np.random.default_rng(4)
    verdicts = []
    for place in rng.uniform(-1.0, 1.0, (40, 3)) * (half + 0.55):
        within = (half - np.abs(ball.points - place)).min(axis=1)
        box = Obstacle(size=tuple(2.0 * half), position=tuple(place))
        allowed = 0.01 * min(float(np.ptp(ball.points, axis=0).max()), float(np.linalg.norm(half)))
        verdicts.append(within.max() > allowed)
        with pytest.raises(InputError, match=f" {within.max():.3g} m deep") if verdicts[-1] else nullcontext():
            plan_model(Scene(balloon=[Balloon(mesh=ball)], obstacle=[box], substeps=64))
    assert 5 < sum(verdicts) < 36


def test_every_world_is_looked_at():
    made = Scene(balloon=[Balloon(mesh=quad_sphere(3, 0.5), name="ball")], obstacle=[Obstacle(position=(0, -1, 0))])
    plan_model(made, 3, {"balloon.position.1": [0.1, 0.2, 0.3], "obstacle.position.1": [-1.0, -2.0, -0.8]})
    with pytest.raises(InputError, match=r"ball starts in world 2 0\.3\d* m deep inside obstacle 0, a box; expected"):
        plan_model(made, 3, {"obstacle.position.1": [-1.0, -2.0, -0.6]})
