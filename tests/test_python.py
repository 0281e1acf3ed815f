"""Package as users of Python meet it: names, sources of scenes, silence, mistakes, help and signatures."""

import inspect
import pydoc
import subprocess
import sys
from collections.abc import Callable
from importlib import metadata
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import trimesh
import warp as wp
from meshes import cube, quad_sphere

import balloon_warp as bw
from balloon_warp import MassProperties
from balloon_warp.batch.batch import BatchSummary
from balloon_warp.mesh.obj import write_obj
from balloon_warp.scene.fields import meaning_of
from balloon_warp.scene.reference import tables
from balloon_warp.system.warp_setup import quiet_warp

SILENT = {
    "names": """
import sys
import balloon_warp as bw
assert {"Simulator", "load_scene", "__version__"} <= set(dir(bw)), dir(bw)
assert not {"warp", "numpy", "pydantic"} & set(sys.modules)  # nothing is loaded yet
import warp
bw.Simulator(([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]), "cpu").step()
""",
    "a law first": """
import warp as wp
import balloon_warp as bw

@wp.func
def pull(position: wp.vec3, mass: float):
    return -mass * position

bw.particle_law(pull)
""",
}
"""programs in which Warp prints nothing, imported before or by a law, whose source it reads from its file"""


@pytest.mark.parametrize("name", [pytest.param("names", marks=pytest.mark.full), "a law first"])
def test_warp_is_silent(name: str, tmp_path: Path):
    (tmp_path / "program.py").write_text(SILENT[name])
    words = [sys.executable, tmp_path / "program.py"]
    done = subprocess.run(words, capture_output=True, text=True, cwd=tmp_path, timeout=600)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


def test_whoever_asks_warp_for_more_hears_it(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(wp.config, "log_level", wp.LOG_DEBUG)
    quiet_warp.__wrapped__()
    assert wp.config.log_level == wp.LOG_DEBUG


def test_the_package_has_a_version_and_asks_about_a_name_that_is_not_there():
    with pytest.raises(AttributeError, match="has no attribute 'Simulater'") as caught:
        _ = bw.Simulater
    assert (caught.value.name, caught.value.obj) == ("Simulater", bw)
    assert bw.__version__ == metadata.version("balloon-warp")


BALL = quad_sphere(3)
AS_LISTS = (BALL.points.tolist(), BALL.face_vertex_indices.reshape(-1, 4).tolist())
OTHERS = {
    "lists": AS_LISTS,
    "arrays": (BALL.points, np.array(AS_LISTS[1])),
    "mesh": BALL,
    "another library's": SimpleNamespace(vertices=BALL.points, faces=AS_LISTS[1]),
}


@pytest.mark.parametrize("kind", OTHERS)
def test_a_mesh_may_be_no_file(kind: str, tmp_path: Path):
    write_obj(tmp_path / "ball.obj", BALL)
    read, given = bw.load_mesh(tmp_path / "ball.obj"), bw.load_mesh(OTHERS[kind])
    np.testing.assert_array_equal(given.points, read.points)
    np.testing.assert_array_equal(given.face_vertex_indices, read.face_vertex_indices)
    around, of_file = bw.load_scene(OTHERS[kind], {"balloon.mass": 3.0}), bw.load_scene(tmp_path / "ball.obj")
    without_mesh = {"balloon": {0: {"mesh", "mass"}}, "description": True}
    assert around.model_dump(exclude=without_mesh) == of_file.model_dump(exclude=without_mesh)
    assert around.balloon[0].mass == 3.0
    np.testing.assert_array_equal(bw.Balloon(mesh=OTHERS[kind]).mesh.points, read.points)


def test_meshes_of_trimesh_are_taken():
    ball, box = trimesh.creation.icosphere(1), trimesh.creation.box()
    box.metadata["name"] = "crate"
    assert (bw.load_mesh(ball).vertex_count, bw.load_mesh(box).name) == (42, "crate")
    assert bw.load_mesh(trimesh.Scene([ball, box])).vertex_count == 42 + 8


def test_a_simulator_takes_what_run_takes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_obj(tmp_path / "ball.obj", BALL)
    (tmp_path / "mine.toml").write_text('frames = 7\n[[balloon]]\nmesh = "ball.obj"\n')
    monkeypatch.chdir(tmp_path)
    assert bw.Simulator("squirrel_tether", "cpu").model.scene == bw.load_scene("squirrel_tether")
    assert bw.Simulator("ball.obj", "cpu").model.scene == bw.load_scene("ball.obj")
    assert bw.Simulator(Path("mine.toml"), "cpu").model.scene.frames == 7
    assert bw.Simulator(AS_LISTS, "cpu").model.particle_count == 56


def scene() -> bw.Scene:
    return bw.Scene(balloon=[bw.Balloon(mesh=cube())])


def simulator(**arguments: Any) -> bw.Simulator:
    return bw.Simulator(scene(), **{"device": "cpu", **arguments})


def test_numbers_and_arrays_of_numpy_are_taken():
    keyframes = {"k_normal": np.array([[0, 1], [2, 3]])}
    balloon = bw.Balloon(mesh=BALL, mass=np.float32(2.0), position=np.arange(3), inflation=keyframes)
    assert (balloon.mass, balloon.position, balloon.inflation.k_normal) == (2.0, (0.0, 1.0, 2.0), [(0, 1), (2, 3)])
    numbers = {"gravity": np.float64(3.0), "balloon.0.velocity": np.ones(3), "frames": np.int64(4)}
    before = scene()
    changed = bw.load_scene(before, numbers)
    assert (changed.gravity, changed.balloon[0].velocity, changed.frames) == (3.0, (1.0, 1.0, 1.0), 4)
    assert (before.gravity, before.frames) != (3.0, 4)  # a scene is changed by making another


MISTAKES: dict[str, tuple[Callable[[], Any], str]] = {
    "field": (lambda: bw.Balloon(mesh="a.obj", mas=3), r"^balloon\.mas: unknown field; did you mean mass\?$"),
    "value": (lambda: bw.Sphere(position=(0, 0, 0), mass=-1), r"^sphere\.mass: must be greater than 0 \(got -1\)$"),
    "whole": (lambda: bw.Inflation(kind="pressure", amount=1.0), r'^inflation\.amount: needs kind = "gas"'),
    "missing": (lambda: bw.Balloon(), r"^balloon\.mesh: is missing$"),
    "unnamed": (lambda: bw.Balloon("a.obj"), r"^Balloon: takes fields by their names, as in Balloon\(mesh=\.\.\.\)$"),
    "set": (lambda: setattr(scene(), "frames", 3), r"^frames: a Scene does not change; load_scene"),
    "no list": (lambda: bw.Scene(balloon=bw.Balloon(mesh=BALL)), r"^balloon: is one Balloon; expected a list of them"),
    "faces": (lambda: bw.load_mesh((BALL.points, [["a"]])), r"^faces: face 0 must be point numbers, counted from 0"),
    "no faces": (lambda: bw.load_mesh((BALL.points, 3)), r"^faces: must be lists of point numbers \(got int\)$"),
    "source": (lambda: bw.Simulator(42), r"^scene: must be a Scene, the name of a bundled scene, a file, or"),
    "no source": (lambda: bw.load_mesh(None), r"^mesh: must be a file, a PolygonMesh, a trimesh\.Trimesh, or a pair"),
    "overrides": (lambda: bw.load_scene(scene(), [1]), r"^overrides: must be dotted paths and values"),
    "vary": (lambda: simulator(world_count=2, vary=[1, 2]), r"^vary: must be paths and values"),
    "worlds": (lambda: simulator(world_count="2"), r"^world_count: must be a whole number or None \(got '2'\)$"),
    "laws": (lambda: simulator(laws=3), r"^laws: must be a list of Laws \(got 3\)$"),
    "device": (lambda: simulator(device="3"), r"^device 3: no such device; this machine has "),
    "world": (lambda: simulator().read_frame("0"), r"^world: no world 0; expected 0 to 0$"),
    "name": (lambda: simulator().set_parameters({"mas": 1}), r"^mas: no such parameter; known are "),
    "shape": (lambda: simulator().set_parameters({"mass": [1, 2]}), r"^mass: must be numbers of shape \(1, 1\)"),
    "nan": (lambda: simulator().set_parameters({"mass": np.nan}), r"^mass: must be finite \(got nan\)$"),
}


def test_names_of_colors_and_presets_are_taken():
    """Names and digits are sRGB: 128 of 255 is 0.216 in linear light (IEC 61966-2-1)."""
    assert bw.Balloon(mesh=BALL, color="red").color == (1.0, 0.0, 0.0)
    assert bw.Balloon(mesh=BALL, color="#ff8000").color == pytest.approx((1.0, 0.21586, 0.0), abs=1e-5)
    assert bw.Balloon(mesh=BALL, material="latex").material == bw.Material(preset="latex")
    (rubber,) = bw.load_scene("squirrel_tether", {"balloon.material": "latex"}).balloon  # its own mass goes
    assert rubber.material == bw.Material(preset="latex")
    assert bw.Balloon(mesh=BALL, material="gent").material == bw.Material(kind="gent")
    (springs,) = bw.load_scene("squirrel_tether", {"balloon.material": "springs"}).balloon
    assert springs.mass == 2.0  # which stays


@pytest.mark.parametrize(
    ("fields", "doubt"),
    [
        ({"gravity": -9.81}, "gravity: -9.81 m/s2 pulls up, since positive is down; meant 9.81?"),
        ({"helium": 14000.0}, "mesh: helium accelerates upward by 14000 m/s2? 11.8 lets it rise slowly"),
    ],
)
def test_signs_and_sizes_that_others_have_are_asked_back(fields: dict[str, float], doubt: str):
    own = {name: value for name, value in fields.items() if name == "helium"}
    others = {name: value for name, value in fields.items() if name not in own}
    of = bw.Scene(balloon=[bw.Balloon(mesh=BALL, **own)], **others)
    assert doubt in bw.Simulator(of, "cpu").warnings


@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_gets_one_sentence(mistake: str):
    make, sentence = MISTAKES[mistake]
    with pytest.raises(bw.InputError, match=sentence) as caught:
        make()
    assert "\n" not in str(caught.value)


def test_everything_says_what_it_is_in_a_line_or_two():
    shown = bw.Simulator(bw.Scene(balloon=[bw.Balloon(mesh=BALL, mass=0.3, name="ball")]), "cpu")
    model = f"Model(ball of 56 particles; 1 world, {shown.model.substeps} substeps a frame, cpu)"
    assert repr(shown) == f"Simulator({model}, frame 0, 0.000 s)"
    assert repr(shown.model.scene.balloon[0]).startswith("Balloon(mesh=PolygonMesh('mesh', 56 vertices, 54 faces), ")
    assert str(shown.model.scene) == f"Scene(balloon=[{shown.model.scene.balloon[0]}])"
    assert repr(shown.read_frame()) == "Frame(0, 0.000 s: ball of 56 particles and 3.72 m^3)"


TABLES = list(dict.fromkeys(table for _, table in tables()))
PYTHONS = ("Annotated[", "FieldInfo", "_SupportsArray", "numpy.dtype", "model_construct", "__dataclass_fields__")
"""words that Python and libraries print and nobody wants to read"""
SIMULATOR = """controls frame_number mass_properties model observations picture read_frame relax reset restore run save
set starts state step stiffness time warnings"""
FRAME = """areas body_poses contacts corners gas_amounts ground_height inflation_forces is_finite meshes net_forces
number obstacle_poses points pressures sphere_positions sphere_velocities stretches string_anchors string_lengths
thrusts time torn velocities volumes water_level"""


@pytest.fixture(scope="module")
def shown() -> bw.Simulator:
    return bw.Simulator(bw.Scene(balloon=[bw.Balloon(mesh=quad_sphere(2))]), "cpu")


def helped(thing: object) -> str:
    """Return the text of help(), without the lines that it draws."""
    return " ".join(pydoc.render_doc(thing, renderer=pydoc.plaintext).replace("|", " ").split())


def test_tab_offers_what_is_public(shown: bw.Simulator):
    assert [name for name in dir(bw) if not name.startswith("__")] == sorted(bw.__all__)
    assert dir(shown) == SIMULATOR.split()
    assert dir(shown.read_frame()) == FRAME.split()
    assert dir(bw.Ground()) == sorted(bw.Ground.model_fields)
    of_one = ("controls", "frame_number", "model", "observations", "starts", "state")
    assert dir(bw.Simulator) == [name for name in SIMULATOR.split() if name not in of_one]


@pytest.mark.parametrize("table", TABLES, ids=lambda table: table.__name__)
def test_help_of_a_table_says_every_field(table: type):
    said = helped(table)
    for name, field in table.model_fields.items():
        default = ", required" if field.is_required() else f" = {' '.join(repr(field.default).split())}"
        assert f"{name}{default}" in said, name
        assert meaning_of(table, name).replace("|", " ").replace("  ", " ") in said, name
    assert not [word for word in PYTHONS if word in said]


@pytest.mark.parametrize(
    "cls", [bw.Frame, bw.Trajectories, bw.PolygonMesh, MassProperties, BatchSummary], ids=lambda cls: cls.__name__
)
def test_help_of_a_result_says_every_field(cls: type):
    said = helped(cls)
    names = inspect.signature(cls).parameters
    assert not [name for name in names if f" {name} (" not in said and f" {name} = " not in said]
    assert not [word for word in PYTHONS[:2] + PYTHONS[4:] if word in said]


@pytest.mark.parametrize("name", [name for name in bw.__all__ if callable(getattr(bw, name))])
def test_signatures_are_short(name: str):
    found = getattr(bw, name)
    if not (inspect.isclass(found) and issubclass(found, Exception)):
        signature = str(inspect.signature(found))
        assert len(signature) < (1000 if inspect.isfunction(found) else 500)
        assert not [word for word in PYTHONS if word in signature]
