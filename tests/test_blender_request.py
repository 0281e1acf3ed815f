"""Requests that the add-on of Blender writes, without Blender: numbers in, a scene and point caches out."""

import math
import struct
import subprocess
import sys
import zipfile
from dataclasses import replace
from importlib.metadata import packages_distributions
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import box, quad_sphere

from balloon_warp import InputError, PolygonMesh, Simulator, simulate
from balloon_warp.blender.__main__ import main
from balloon_warp.blender.addon.request import (
    HEADER,
    PointCache,
    RefusedError,
    Snapshot,
    Thing,
    samples_of,
    turn_angles,
    write_request,
)
from balloon_warp.blender.bake import led_frames
from balloon_warp.blender.extension import write_own_wheel
from balloon_warp.blender.request import Cached, local_points, moved, read_request, torn_faces
from balloon_warp.mesh.topology import signed_volume

BALL = quad_sphere(3)
SETTINGS = {
    "role": "BALLOON",
    "material": "SPRINGS",
    "stiffness": 80.0,
    "inflate": "VOLUME",
    "volume": 8.0,
    "litres": 2.0,
    "fill_time": 0.5,
    "filling": "AIR",
    "mass": 0.2,
    "lift": 9.0,
    "drag": 0.5,
    "damping": 0.1,
    "friction": 0.3,
    "burst": "NEVER",
    "strength": 20.0,
    "burst_frame": 3,
}
SURROUNDINGS = {"ground": True, "ground_height": 2.0, "touch": True, "quality": "GOOD"}


def place(*, scale: Any = 1.0, turn: float = 0.0, at: Any = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Return the matrix of an object that is scaled, turned about z, and moved."""
    matrix = np.eye(4)
    cosine, sine = math.cos(turn), math.sin(turn)
    matrix[:3, :3] = np.array([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]) * scale
    matrix[:3, 3] = at
    return matrix


def thing(mesh: PolygonMesh = BALL, places: Any = None, name: str = "Ball", **settings: Any) -> Thing:
    matrices = np.array([np.eye(4)] if places is None else places)
    skin = mesh.points, mesh.face_vertex_counts, mesh.face_vertex_indices
    return Thing(name, SETTINGS | settings, *skin, matrices, amounts=[8.0])


def snapshot(*things: Thing, meters: float = 1.0, **surroundings: Any) -> Snapshot:
    return Snapshot(list(things), 1, 4, 25.0, meters, np.array([9.81]), SURROUNDINGS | surroundings)


def scene_of(folder: Path, asked: Snapshot) -> Any:
    write_request(folder, asked)
    return read_request(folder).scene


def test_a_balloon_is_in_meters_in_the_world(tmp_path: Path):
    asked = snapshot(thing(places=[place(scale=(2.0, 1.0, 1.0), at=(1.0, 0.0, 3.0))]), meters=0.01)
    scene = scene_of(tmp_path, asked)
    (balloon,) = scene.balloon
    assert np.allclose(balloon.mesh.points, 0.01 * (BALL.points * (2.0, 1.0, 1.0) + (1.0, 0.0, 3.0)))
    assert (scene.up_axis, scene.frames, scene.frames_per_second) == ("Z", 4, 25.0)
    assert scene.gravity == pytest.approx(0.0981)  # which Blender shows with such a unit
    assert scene.ground.height == pytest.approx(0.02)
    assert balloon.inflation.stretch == pytest.approx(1.0)
    assert (balloon.mass, balloon.helium, balloon.drag_coefficient) == (0.2, 9.0, 0.0)


def test_a_mirrored_object_is_wound_outward(tmp_path: Path):
    for scale in ((-1.0, 1.0, 1.0), (-1.0, -2.0, 1.0)):
        scene = scene_of(tmp_path, snapshot(thing(places=[place(scale=scale)])))
        assert signed_volume(scene.balloon[0].mesh) > 0.0


@pytest.mark.parametrize(
    ("inflate", "amounts", "said"),
    [
        ("PRESSURE", [7.0], {"kind": "pressure", "pressure": 7.0}),
        ("LITRES", [7.0], {"kind": "gas", "litres": 7.0, "fill_time": 0.5, "molar_mass": 0.0289652}),
        ("PRESSURE", [0.0, 1.0, 3.0, 2.0], {"pressure": [(0.0, 0.0), (0.04, 1.0), (0.08, 3.0), (0.12, 2.0)]}),
    ],
)
def test_inflations_go_into_fields_of_their_names(inflate: str, amounts: list[float], said: dict, tmp_path: Path):
    """An animated one has a keyframe a frame."""
    balloon = thing(inflate=inflate)
    balloon.amounts = amounts
    inflation = scene_of(tmp_path, snapshot(balloon)).balloon[0].inflation
    assert {name: getattr(inflation, name) for name in said} == said


def test_an_animated_volume_is_reached(tmp_path: Path):
    volumes = np.linspace(1.0, 2.0, 76)
    balloon = thing(quad_sphere(4), lift=9.81, damping=3.0)
    balloon.amounts = [*volumes, *[2.0] * 25]
    asked = snapshot(balloon, ground=False)
    asked.frames, asked.frames_per_second = 100, 25.0
    scene = scene_of(tmp_path, asked)
    grown = simulate(scene, device="cpu").volumes[:, 0]
    assert grown[-1] / grown[0] == pytest.approx(2.0, rel=0.05)  # as near as the pressure of "auto" comes
    assert grown[38] / grown[0] == pytest.approx(volumes[38], rel=0.08)


def test_animated_litres_are_pumped(tmp_path: Path):
    balloon = thing(inflate="LITRES")
    balloon.amounts = [1.0, 2.0, 4.0, 6.0, 6.0]
    (said,) = scene_of(tmp_path, snapshot(balloon)).balloon
    times, flows = np.array(said.inflation.pump).T
    litres = np.trapezoid(flows, times) * 8.314462618 * 293.15 / 101.325
    assert litres == pytest.approx(6.0, abs=0.3)  # half a frame's change of the flow at each end


def test_an_obstacle_moves_and_turns_as_its_matrices(tmp_path: Path):
    turns = np.linspace(0.0, 1.5, 5)
    places = [place(turn=0.3 + turn, at=(turn, 0.0, 1.0), scale=(1.0, 2.0, 3.0)) for turn in turns]
    wall = thing(box((0, 0, 0), (1, 1, 1)), places, "Wall", role="OBSTACLE")
    (obstacle,) = scene_of(tmp_path, snapshot(thing(), wall)).obstacle
    assert obstacle.position == (0.0, 0.0, 1.0)
    for (time, shift, turn), expected in zip(obstacle.motion, turns, strict=True):
        assert shift == pytest.approx((expected, 0.0, 0.0))
        assert turn == pytest.approx((0.0, 0.0, math.degrees(expected)))
        assert time == pytest.approx(0.04 * list(turns).index(expected))


def test_an_obstacle_that_bends_is_led(tmp_path: Path):
    """Points that are fixed, and get velocities, make such an obstacle."""
    steps = np.array([[0.0, 0.0, 0.01 * frame**2] for frame in range(5)])
    wall = thing(box((0, 0, 0), (1, 1, 1)), [place(at=(3.0, 0.0, 0.0))], "Wall", role="OBSTACLE")
    wall.pinned = np.arange(len(wall.points))
    wall.paths = wall.points + (3.0, 0.0, 0.0) + steps[:, None] * wall.points[:, :1]
    write_request(tmp_path, snapshot(thing(), wall, ground=False))
    request = read_request(tmp_path)
    assert [balloon.name for balloon in request.scene.balloon] == ["Ball", "Wall"]
    frames = list(led_frames(Simulator(request.scene, "cpu"), request))
    assert len(frames) == 5
    for frame in frames:
        assert np.abs(frame.points[1] - wall.paths[frame.number]).max() < 1e-6


def test_contact_that_cannot_be_is_refused(tmp_path: Path):
    wall = thing(name="Wall", role="OBSTACLE")
    wall.pinned = np.arange(len(wall.points))
    with pytest.raises(RefusedError, match="Wall: bends, and pushes balloons as one of them; expected Touch"):
        write_request(tmp_path, snapshot(thing(), wall, touch=False))
    latex = thing(material="LATEX", burst="STRESS")
    for other, said in ((wall, "Wall, which bends,"), (thing(), "other balloons")):
        with pytest.raises(RefusedError, match=f"Ball: may burst, and cannot touch {said}"):
            write_request(tmp_path, snapshot(latex, other))
    assert not list(tmp_path.iterdir())


def test_a_balloon_bursts_at_its_strength_or_a_needle(tmp_path: Path):
    for burst, time in (("STRESS", 1e9), ("NEEDLE", 2 / 25)):
        scene = scene_of(tmp_path, snapshot(thing(material="LATEX", burst=burst)))
        assert scene.balloon[0].material.strength == 20.0e6
        assert scene.balloon[0].material.needle_time == pytest.approx(time)
    assert scene_of(tmp_path, snapshot(thing(burst="NEEDLE"))).balloon[0].material.strength is None  # springs


def test_torn_faces_are_known_by_their_corners():
    """A repaired mesh may have other faces in another order, and welded corners."""
    given = PolygonMesh(np.zeros((6, 3)), np.array([3, 3]), np.array([0, 1, 2, 3, 4, 5]))
    stand_ins = np.array([0, 1, 2, 2, 4, 5])
    repaired = replace(given, face_vertex_indices=np.array([4, 2, 5, 2, 1, 0]), stand_ins=stand_ins)
    assert torn_faces(given, repaired, np.array([True, False])).tolist() == [False, True]
    assert torn_faces(given, repaired, np.array([False, True])).tolist() == [True, False]


def test_turns_have_no_jumps():
    from scipy.spatial.transform import Rotation

    steps = np.linspace(0.0, 4.0 * np.pi, 200)
    axis = np.array([0.3, 0.5, -0.8])
    turns = Rotation.from_rotvec(steps[:, None] * axis / np.linalg.norm(axis))
    angles = turn_angles(turns.as_matrix())
    assert (Rotation.from_euler("xyz", angles, degrees=True) * turns.inv()).magnitude().max() < 1e-6
    assert np.abs(np.diff(angles, axis=0)).max() < 30.0
    whole = Rotation.from_rotvec(steps[:, None] * (0.0, 0.0, 1.0)).as_matrix()
    assert turn_angles(whole)[-1] == pytest.approx([0.0, 0.0, 720.0])


def test_a_string_holds_the_nearest_vertex(tmp_path: Path):
    balloon = thing(places=[place(at=(0.0, 0.0, 5.0))])
    balloon.anchors = np.array([[0.0, 0.0, 9.0], [1.0, 0.0, 9.0]])
    (string,) = scene_of(tmp_path, snapshot(balloon)).string
    assert string.anchor == (0.0, 0.0, 9.0)
    distances = np.linalg.norm(BALL.points + (0.0, 0.0, 5.0) - string.anchor, axis=1)
    assert distances[string.particle] == distances.min()
    assert string.motion == [(0.0, (0.0, 0.0, 0.0)), (0.04, (1.0, 0.0, 0.0))]


def test_wind_that_changes_is_a_change_a_frame(tmp_path: Path):
    asked = snapshot(thing())
    asked.winds = np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 0.0], [2.0, 0.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
    scene = scene_of(tmp_path, asked)
    assert scene.atmosphere.wind == (1.0, 0.0, 0.0)
    assert scene.balloon[0].drag_coefficient == 0.5
    changes = [(change.time, change.set) for change in scene.change]
    assert changes == [(0.08, {"atmosphere.wind": [2.0, 0.0, 0.0]}), (0.16, {"atmosphere.wind": [0.0, 0.0, 0.0]})]


def test_a_mistake_names_the_object(tmp_path: Path):
    write_request(tmp_path, snapshot(thing(mass=-1.0, name="Cube.001")))
    with pytest.raises(InputError, match=r"^Cube\.001, mass: "):
        read_request(tmp_path)
    with pytest.raises(InputError, match="expected a bake that Blender's panel began"):
        read_request(tmp_path / "nowhere")


def test_points_return_to_the_axes_of_their_object():
    places = np.array([place(scale=(-2.0, 1.0, 0.5), turn=0.4, at=(1.0, 2.0, 3.0))])
    world = 0.1 * (BALL.points @ places[0, :3, :3].T + places[0, :3, 3])
    cached = Cached("Ball", "balloon", 0, "ball.pc2", replace(BALL, points=world), places)

    class Frame:
        number, points = 3, [world.astype(np.float32)]

    found = local_points(cached, Frame(), np.empty((0, 7)), 0.1)  # pyright: ignore[reportArgumentType]
    assert np.abs(found - BALL.points).max() < 1e-5


def test_points_of_a_body_go_along_with_its_pose():
    half = math.sqrt(0.5)
    turned = moved(
        np.array([[2.0, 0.0, 0.0]]), np.array([1.0, 0, 0, 0, 0, 0, 1]), np.array([0.0, 0, 5, 0, 0, half, half])
    )
    assert turned[0] == pytest.approx([0.0, 1.0, 5.0])


def test_a_cache_grows_and_goes_on(tmp_path: Path):
    path, points = tmp_path / "ball.pc2", np.arange(6.0, dtype=np.float32).reshape(2, 3)
    cache = PointCache(path, 2)
    for number in range(3):
        cache.write(number, points + number)
        assert samples_of(path, 2) == number + 1  # a reader sees it at once
    cache.close()
    content = path.read_bytes()
    assert struct.unpack("<12siiffi", content[:32]) == (b"POINTCACHE2\0", 1, 2, 0.0, 1.0, 3)
    assert np.array_equal(np.frombuffer(content[32:], "<f4").reshape(3, 2, 3)[2], points + 2)
    again = PointCache(path, 2)
    assert again.sample_count == 3
    again.write(1, points)  # which is to be simulated again
    again.close()
    assert samples_of(path, 2) == 2
    assert samples_of(path, 3) == 0
    assert len(path.read_bytes()) == HEADER.size + 3 * 24


def test_the_zip_without_wheels_is_the_add_on_alone(tmp_path: Path, capsys: pytest.CaptureFixture):
    assert main([str(tmp_path / "out.zip"), "--no-wheels"]) == 0
    names = zipfile.ZipFile(tmp_path / "out.zip").namelist()
    assert {"blender_manifest.toml", "__init__.py", "panel.py"} <= set(names)
    assert not any("/" in name for name in names)
    assert main([str(tmp_path / "out.zip"), "--platform", "amiga"]) == 2
    assert capsys.readouterr().err.startswith("--platform: expected one of linux-x64")


def test_the_studio_look_is_a_script_that_needs_nothing_beside_it(tmp_path: Path, capsys: pytest.CaptureFixture):
    assert main([str(tmp_path / "look.py")]) == 0
    assert f"blender --python {tmp_path / 'look.py'}" in capsys.readouterr().out
    source = (tmp_path / "look.py").read_text(encoding="utf-8")
    modules = {
        line.split()[1].partition(".")[0] for line in source.splitlines() if line.startswith(("import ", "from "))
    }
    assert modules <= {"bpy", "mathutils", *sys.stdlib_module_names}
    assert main([str(tmp_path / "none" / "look.py")]) == 2


@pytest.mark.full
def test_the_own_wheel_bakes_with_what_is_listed_alone(tmp_path: Path):
    """The wheel runs where nothing but it, NumPy and the listed requirements can be imported."""
    wheel = write_own_wheel(tmp_path)
    zipfile.ZipFile(wheel).extractall(tmp_path / "site")
    write_request(tmp_path / "bake", snapshot(thing()))
    needed = {"numpy", "balloon_warp", "warp", "scipy", "pydantic", "typing_extensions"}
    needed |= {"pydantic_core", "annotated_types", "typing_inspection"}  # which pydantic needs
    others = set(packages_distributions()) - needed
    script = f"""
import sys

class Others:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {others!r}:
            raise ModuleNotFoundError(f"not in Blender: {{name}}", name=name)

sys.path.insert(0, {str(tmp_path / "site")!r})
sys.meta_path.insert(0, Others())
from balloon_warp.blender.bake import main
import balloon_warp
assert balloon_warp.__file__.startswith({str(tmp_path)!r})
sys.exit(main([{str(tmp_path / "bake")!r}, "--device", "cpu"]))
"""
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=False, cwd=tmp_path)
    assert done.returncode == 0, done.stdout + done.stderr
    assert (tmp_path / "bake" / "000_Ball.pc2").exists()
