"""Stages of other programs: shapes that are no meshes, instances of a PointInstancer, and time codes that are not
frames, for all that read stages. Those that ask for too much are refused before USD reads or composes them."""

import os
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from meshes import cube
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom
from test_mesh_files import add_mesh, move

from balloon_warp import Balloon, InputError, Obstacle, PolygonMesh, Scene, check_stage, export_stage, load_mesh
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.mesh.usd_open import open_stage
from balloon_warp.mesh.usd_stage import read_motions
from balloon_warp.model import plan_model
from balloon_warp.model.obstacles import obstacle_motion
from balloon_warp.studio.exports.parts import Animation
from balloon_warp.studio.render.stage_reader import RenderStage


class Files:
    """A stage in meters, Y up, and its file."""

    def __init__(self, path: Path):
        self.path = path
        self.stage = Usd.Stage.CreateNew(str(path))
        UsdGeom.SetStageUpAxis(self.stage, UsdGeom.Tokens.y)
        UsdGeom.SetStageMetersPerUnit(self.stage, 1.0)

    def saved(self) -> Path:
        self.stage.Save()
        return self.path

    def read(self, prim: str | None = None) -> PolygonMesh:
        return load_mesh(self.saved(), prim)

    def scatter(self, path: str, places: list[tuple[float, float, float]], **prototypes: str) -> UsdGeom.PointInstancer:
        """Add a PointInstancer of cubes of 1 m, or of other prims, at places."""
        instancer = UsdGeom.PointInstancer.Define(self.stage, path)
        if not prototypes:
            add_mesh(self.stage, f"{path}/Protos/Rock", cube())
        targets = [Sdf.Path(each) for each in prototypes.values()] or [Sdf.Path(f"{path}/Protos/Rock")]
        instancer.CreatePrototypesRel().SetTargets(targets)
        instancer.CreatePositionsAttr(places)
        instancer.CreateProtoIndicesAttr([number % len(targets) for number in range(len(places))])
        return instancer


@pytest.fixture
def files(tmp_path: Path) -> Files:
    return Files(tmp_path / "stage.usda")


ROUND = np.pi
SHAPES = {
    "Cube": ({"size": 2.0}, 8.0, (2, 2, 2)),
    "Sphere": ({"radius": 0.5}, ROUND / 6.0, (1, 1, 1)),
    "Cylinder": ({"radius": 0.5, "height": 3.0, "axis": "X"}, ROUND * 0.75, (3, 1, 1)),
    "Cylinder_1": ({"radiusTop": 0.25, "radiusBottom": 0.5, "height": 3.0, "axis": "Y"}, ROUND * 7 / 16, (1, 3, 1)),
    "Cone": ({"radius": 0.5, "height": 3.0}, ROUND * 0.25, (1, 1, 3)),
    "Capsule": ({"radius": 0.5, "height": 2.0}, ROUND * (0.5 + 1.0 / 6.0), (1, 1, 3)),
    "Capsule_1": ({"radiusTop": 0.5, "radiusBottom": 0.5, "height": 2.0}, ROUND * (0.5 + 1.0 / 6.0), (1, 1, 3)),
    "Plane": ({"width": 2.0, "length": 4.0, "axis": "Y"}, 0.0, (2, 0, 4)),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_a_shape_is_a_mesh_for_all_that_read_stages(files: Files, kind: str):
    sizes, volume, box = SHAPES[kind]
    prim = files.stage.DefinePrim("/Room/Thing", kind)
    for name, value in sizes.items():
        prim.GetAttribute(name).Set(value)
    UsdGeom.Gprim(prim).CreateDisplayColorAttr([(1.0, 0.0, 0.0)])
    prim.CreateAttribute("orientation", Sdf.ValueTypeNames.Token).Set("leftHanded")
    move(UsdGeom.Xformable(prim), 5.0)
    mesh = files.read()
    assert signed_volume(mesh) == pytest.approx(volume, rel=0.02)
    np.testing.assert_allclose(np.ptp(mesh.points, axis=0), box, atol=1e-6)
    assert mesh.points.mean(axis=0)[0] == pytest.approx(5.0, abs=0.2)
    assert (mesh.name, mesh.warnings) == ("Thing", ())
    assert mesh.looks is not None
    assert mesh.looks.materials[0].color == (1.0, 0.0, 0.0)
    drawn = RenderStage(files.path)
    drawn.read_prims(0.0)
    assert len(drawn.meshes) + len(drawn.rounds) == 1
    animation = Animation(files.path)
    (part,) = animation.parts
    np.testing.assert_allclose(part.points(0), mesh.points, atol=1e-6)
    assert part.color == (1.0, 0.0, 0.0)


@pytest.mark.parametrize("kind", ["Cube", "Cylinder", "Cone", "Capsule", "Sphere"])
def test_check_finds_what_crosses_a_shape(files: Files, kind: str):
    ball = add_mesh(files.stage, "/Ball", cube())
    for frame in (0, 1):
        ball.GetPointsAttr().Set(ball.GetPointsAttr().Get(), frame)
    files.stage.DefinePrim("/Table", kind)
    (crossing, _) = check_stage(files.saved(), device="cpu").crossings
    assert "balloon Ball" in (crossing.first, crossing.second)
    assert crossing.depth > 0.2


def test_an_ellipsoid_is_one_in_pictures(files: Files):
    prim = UsdGeom.Sphere.Define(files.stage, "/Egg")
    prim.AddScaleOp().Set(Gf.Vec3f(1, 2, 1))
    drawn = RenderStage(files.saved())
    drawn.read_prims(0.0)
    assert not drawn.rounds
    np.testing.assert_allclose(np.ptp(drawn.points(0.0)[0], axis=0), (2, 4, 2), atol=1e-6)


def test_a_shape_inside_an_instance_is_found(files: Files):
    files.stage.CreateClassPrim("/prototype")
    files.stage.DefinePrim("/prototype/deeper/cube", "Cube")
    for x, name in enumerate("ab"):
        instance = UsdGeom.Xform.Define(files.stage, f"/{name}")
        instance.GetPrim().GetReferences().AddInternalReference("/prototype")
        instance.GetPrim().SetInstanceable(True)
        move(instance, 5.0 * x)
    mesh = files.read()
    assert mesh.face_count == 12
    assert np.ptp(mesh.points, axis=0)[0] == 7.0


@pytest.mark.parametrize(
    ("value", "said"), [(float("nan"), r"/Ball.radius is nan; expected a finite"), (-1.0, "is -1; expected a finite")]
)
def test_a_size_that_is_none_gets_a_sentence(files: Files, value: float, said: str):
    UsdGeom.Sphere.Define(files.stage, "/Ball").CreateRadiusAttr(value)
    with pytest.raises(InputError, match=said):
        files.read()


def test_what_grows_is_no_rigid_obstacle(files: Files):
    radius = UsdGeom.Sphere.Define(files.stage, "/Ball").CreateRadiusAttr()
    for time in (0.0, 1.0):
        radius.Set(1.0 + time, time)
    assert np.ptp(files.read().points, axis=0).max() == pytest.approx(2.0, rel=0.01)
    (motion,) = read_motions(files.path, None)
    with pytest.raises(InputError, match="/Ball deforms"):
        motion.matrices([0.0, 1.0])


@pytest.mark.parametrize("kind", ["NurbsPatch", "Points", "BasisCurves"])
def test_what_cannot_be_taken_is_named(files: Files, kind: str):
    """Curves are drawn if they are linear, which these are not."""
    add_mesh(files.stage, "/Room/Floor", cube())
    files.stage.DefinePrim("/Room/Table", kind)
    UsdGeom.Imageable(files.stage.DefinePrim("/Room/Hidden", kind)).MakeInvisible()
    notes = [*files.read().warnings, *files.read("/Room").warnings]
    RenderStage(files.path, on_note=notes.append)
    check_stage(files.path, device="cpu", on_note=notes.append)
    export_stage(files.path, files.path.with_suffix(".glb"), on_note=notes.append)
    assert len(notes) >= 5
    assert all(f"Left out of the stage: /Room/Table ({kind}" in each for each in notes[:5])
    assert not any("Hidden" in each for each in notes)
    files.stage.RemovePrim("/Room/Floor")
    with pytest.raises(InputError, match=rf"has no mesh .*/Room/Table \({kind}\)"):
        files.read()


def corners(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return the least corner of each cube that a mesh has, shape (n, 3)."""
    return mesh.points.reshape(-1, 8, 3).min(axis=1)


def test_a_point_instancer_is_what_it_scatters(files: Files):
    instancer = files.scatter("/Set/Rocks", [(0, 0, 0), (2, 0, 0), (4, 0, 0), (6, 0, 0)])
    instancer.CreateScalesAttr([(1, 1, 1), (1, 2, 1), (1, 1, 1), (1, 1, 1)])
    instancer.CreateInvisibleIdsAttr([2])
    move(UsdGeom.Xform.Define(files.stage, "/Set"), 10.0)
    mesh = files.read()
    np.testing.assert_allclose(corners(mesh), cube().points.min(axis=0) + [(10, 0, 0), (12, 0, 0), (16, 0, 0)])
    assert mesh.points[8:16, 1].min() == 2.0 * cube().points[:, 1].min()
    assert mesh.warnings == ()
    assert files.read("/Set/Rocks/Rock_1").face_count == 6
    assert len(Animation(files.path).parts) == 3
    assert len(check_stage(files.path, device="cpu").things) == 3


def test_instances_of_instances_of_shapes_elsewhere_are_found(files: Files):
    files.stage.CreateClassPrim("/Kinds")
    files.stage.DefinePrim("/Kinds/Box", "Cube")
    files.scatter("/Kinds/Pair", [(0, 0, 0), (0, 5, 0)], box="/Kinds/Box")
    files.scatter("/Set", [(0, 0, 0), (7, 0, 0)], pair="/Kinds/Pair")
    np.testing.assert_allclose(corners(files.read()) + 1.0, [(0, 0, 0), (0, 5, 0), (7, 0, 0), (7, 5, 0)])


def test_instances_move_apart(files: Files):
    instancer = files.scatter("/Rocks", [(0, 0, 0), (5, 0, 0)])
    for time in (0.0, 24.0):
        instancer.GetPositionsAttr().Set([(0, time, 0), (5, 2.0 * time, 0)], time)
    files.stage.SetTimeCodesPerSecond(24.0)
    motions = read_motions(files.saved(), None)
    assert [motion.matrices([1.0])[0, 1, 3] for motion in motions] == [24.0, 48.0]


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("protoIndices", [0, 1], "protoIndices do not match its 1 prototypes"),
        ("positions", [(0, 0, 0)], "it places 0 instances of 2"),
    ],
)
def test_instances_that_do_not_fit_are_named(files: Files, name: str, value: list, said: str):
    files.scatter("/Rocks", [(0, 0, 0), (5, 0, 0)]).GetPrim().GetAttribute(name).Set(value)
    assert said in files.read().warnings[0]


def test_a_converted_stage_keeps_its_shapes(files: Files):
    files.stage.DefinePrim("/Table", "Cube")
    files.scatter("/Rocks", [(0, 0, 0), (5, 0, 0)])
    export_stage(files.saved(), files.path.with_name("out.usda"))
    kept = Usd.Stage.Open(str(files.path.with_name("out.usda")))
    kinds = [kept.GetPrimAtPath(path).GetTypeName() for path in ("/Table", "/Rocks")]
    assert kinds == ["Cube", "PointInstancer"]


SECONDS = np.arange(25) / 24.0


def moving(path: Path, codes: np.ndarray, rate: float, where: np.ndarray = SECONDS, **told: float) -> Path:
    """Return a cube that moves along x, at these codes by these distances [m]: a meter a second by default."""
    files = Files(path)
    files.stage.SetTimeCodesPerSecond(rate)
    translation = add_mesh(files.stage, "/cube", cube()).AddTranslateOp()
    for code, place in zip(codes.tolist(), where.tolist(), strict=True):
        translation.Set(Gf.Vec3d(place, 0.0, 0.0), code)
    for name, value in told.items():
        files.stage.SetMetadata(name, value)
    return files.saved()


def times_and_places(path: Path) -> tuple[list[float], list[float]]:
    """Return the seconds of the frames, and the place of the cube's first corner in each."""
    animation = Animation(path)
    (part,) = animation.parts
    frames = list(animation.frames)
    return [animation.seconds(frame) for frame in frames], [float(part.points(frame)[0, 0]) for frame in frames]


@pytest.mark.parametrize(
    ("codes", "rate", "told"),
    [
        (24.0 * SECONDS, 24.0, {}),  # no range
        (1001.0 + 24.0 * SECONDS, 24.0, {"startTimeCode": 1001.0, "endTimeCode": 1025.0}),
        (1.0 * SECONDS, 1.0, {"startTimeCode": 0.0, "endTimeCode": 1.0}),  # seconds
        (4800.0 * SECONDS, 4800.0, {"startTimeCode": 0.0, "endTimeCode": 4800.0}),
        (24.0 * SECONDS, 24.0, {"startTimeCode": -1e7, "endTimeCode": 2e7}),  # wider than the samples
        (24.0 * SECONDS, 24.0, {"startTimeCode": 500.0, "endTimeCode": 600.0}),  # of other samples
        (0.5 + 24.0 * SECONDS, 24.0, {}),  # between codes
        (7.3 + 100.0 * SECONDS, 100.0, {}),
    ],
)
def test_frames_are_the_samples_own_times(tmp_path: Path, codes: np.ndarray, rate: float, told: dict[str, float]):
    times, places = times_and_places(moving(tmp_path / "cube.usda", codes, rate, **told))
    np.testing.assert_allclose(times, SECONDS, atol=1e-9)
    np.testing.assert_allclose(places, SECONDS, atol=1e-6)  # samples are shifted by a millionth of a frame


def test_a_range_narrower_than_the_samples_bounds_them(tmp_path: Path):
    path = moving(tmp_path / "cube.usda", 24.0 * SECONDS, 24.0, startTimeCode=6.0, endTimeCode=18.0)
    times, places = times_and_places(path)
    np.testing.assert_allclose(times, SECONDS[:13], atol=1e-9)
    np.testing.assert_allclose(places, SECONDS[6:19], atol=1e-9)


def test_where_nothing_moves_there_is_one_frame(tmp_path: Path):
    path = moving(tmp_path / "cube.usda", SECONDS[:1], 24.0, SECONDS[:1], startTimeCode=-1e7, endTimeCode=2e7)
    assert times_and_places(path) == ([0.0], [0.0])


def test_keyframes_far_apart_are_shown_at_the_rate_that_the_stage_says(tmp_path: Path):
    """Two keyframes, a second apart, are sampled at the stage's rate, in seconds and in 4,800 codes a second."""
    for rate in (1.0, 4800.0):
        told = {"where": np.array([0.0, 1.0]), "framesPerSecond": 24.0}
        path = moving(tmp_path / f"{rate:g}.usda", np.array([0.0, rate]), rate, **told)
        times, places = times_and_places(path)
        np.testing.assert_allclose(times, SECONDS, atol=1e-9)
        np.testing.assert_allclose(places, SECONDS, atol=1e-6)


@pytest.mark.parametrize("rate", [0.0, -24.0])
def test_time_that_does_not_run_is_refused(tmp_path: Path, rate: float):
    path = moving(tmp_path / "cube.usda", 24.0 * SECONDS, rate)
    sentence = rf"cube\.usda: its timeCodesPerSecond is {rate:g}; expected a rate above 0$"
    with pytest.raises(InputError, match=sentence):
        Animation(path)
    scene = Scene(balloon=[Balloon(mesh=cube(), position=(0.0, 9.0, 0.0))], obstacle=[Obstacle(mesh=path)])
    with pytest.raises(InputError, match=sentence):
        plan_model(scene)


def test_an_obstacle_moves_within_the_range_of_its_stage(tmp_path: Path):
    path = moving(tmp_path / "cube.usda", 4800.0 * SECONDS, 4800.0, startTimeCode=1200.0, endTimeCode=3600.0)
    scene = Scene(balloon=[Balloon(mesh=cube(), position=(0.0, 9.0, 0.0))], obstacle=[Obstacle(mesh=path)])
    along = obstacle_motion(scene)[:, 0, 0]
    np.testing.assert_allclose(along[[0, 15, 30]], [0.25, 0.5, 0.75], atol=1e-9)
    assert along.max() == pytest.approx(0.75)


MESH = """def Mesh "M" {
    int[] faceVertexCounts = [3, 3, 3, 3]
    int[] faceVertexIndices = [0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)]
}
"""


def doubling(levels: int) -> str:
    text = f'def "L0" {{ {MESH} }}\n'
    for level in range(levels):
        both = "".join(f'def "{name}" (references = </L{level}>) {{}}\n' for name in "ab")
        text += f'def "L{level + 1}" {{\n{both}}}\n'
    return text


def chain(length: int) -> str:
    links = "".join(f'def "a{number}" (references = </a{number + 1}>) {{}}\n' for number in range(length))
    return f'{links}def "a{length}" {{}}\n'


def scattered(levels: int) -> str:
    text = f'def "L0" {{ {MESH} }}\n'
    for level in range(levels):
        twice = f"rel prototypes = </L{level}>\n int[] protoIndices = [0, 0]\n"
        text += f'def PointInstancer "L{level + 1}" {{ {twice} }}\n'
    return text


TEXTS = {
    "prims in prims": ('def "a" {\n' * 100_000 + "}\n" * 100_000, "is nested 100,000 deep; expected at most 500"),
    "prims after strings": (
        'def "a" { string b = "}}}\\"}" # }}}}\n' * 1_000 + "}" * 1_000,
        "is nested 1,000 deep; expected at most 500",
    ),
    "dictionaries": (
        f"(customLayerData = {'{ dictionary a = ' * 50_000}{{}}{'}' * 50_000})\n",
        "is nested 50,002 deep; expected at most 500",
    ),
    "numbers": (f'def "a" {{ float b = {"(" * 9_000}1{")" * 9_000} }}', "is nested 9,001 deep; expected at most 500"),
    "references that double": (doubling(25), "has more than 1,000,000 prims with all that references repeat"),
    "instances that double": (scattered(25), "has more than 1,000,000 prims with all that references repeat"),
    "a chain of references": (chain(20_000), "has more than 100 references that follow each other"),
    "a circle": (
        'def "a" (references = </b>) {}\ndef "b" (references = </a>) {}\n',
        "its references go in a circle, through /",
    ),
    "a pipe": ('def "a" (references = @./pipe.usdc@) {}\n', "pipe.usdc: is not a regular file"),
    "a pipe as a payload": ('def "a" (payload = @./pipe.usdc@) {}\n', "pipe.usdc: is not a regular file"),
    "a device as a layer": ("(subLayers = [@./zero.usda@])\n", "zero.usda: is not a regular file"),
}


@pytest.mark.parametrize("name", TEXTS)
def test_a_stage_that_asks_for_too_much_is_refused(name: str, tmp_path: Path):
    os.mkfifo(tmp_path / "pipe.usdc")
    (tmp_path / "zero.usda").symlink_to("/dev/zero")
    text, said = TEXTS[name]
    (tmp_path / "stage.usda").write_text(f"#usda 1.0\n{text}")
    with pytest.raises(InputError, match=said.replace("(", r"\(")):
        open_stage(tmp_path / "stage.usda")


@pytest.mark.parametrize("read", [load_mesh, RenderStage, lambda path: check_stage(path, device="cpu")])
def test_all_readers_refuse_it(read: Callable[[Path], object], tmp_path: Path):
    (tmp_path / "stage.usda").write_text(f"#usda 1.0\n{doubling(25)}")
    with pytest.raises(InputError, match="has more than 1,000,000 prims"):
        read(tmp_path / "stage.usda")


def test_the_text_in_a_package_is_looked_at(tmp_path: Path):
    with zipfile.ZipFile(tmp_path / "stage.usdz", "w", zipfile.ZIP_STORED) as package:
        package.writestr("stage.usda", "#usda 1.0\n" + 'def "a" {\n' * 100_000)
    with pytest.raises(InputError, match="is nested 100,000 deep"):
        open_stage(tmp_path / "stage.usdz")


def test_prims_of_a_binary_file_in_each_other_are_counted(tmp_path: Path):
    layer = Sdf.Layer.CreateNew(str(tmp_path / "stage.usdc"))
    Sdf.CreatePrimInLayer(layer, f"/{'/'.join('a' * 600)}")
    layer.Save()
    with pytest.raises(InputError, match="has more than 500 prims in each other"):
        open_stage(tmp_path / "stage.usdc")


def test_sublayers_that_multiply_are_refused(tmp_path: Path):
    for number in range(12):
        layers = ", ".join([f"@./s{number + 1}.usda@"] * 2)
        (tmp_path / f"s{number}.usda").write_text(f"#usda 1.0\n(subLayers = [{layers}])\n")
    (tmp_path / "s12.usda").write_text("#usda 1.0\n")
    with pytest.raises(InputError, match="has more than 1,000 sublayers, repeated ones included"):
        open_stage(tmp_path / "s0.usda")


def test_what_real_stages_do_is_not_refused(tmp_path: Path):
    """References into referenced prims, inherited classes, variants, layers beside, and the same many times."""
    (tmp_path / "rock.usda").write_text(f'#usda 1.0\n(defaultPrim = "Rock")\ndef "Rock" {{ {MESH} }}\n')
    (tmp_path / "layer.usda").write_text('#usda 1.0\nover "World" {\n over "a" {\n custom int x = 1\n }\n }\n')
    many = "".join(f'def "r{number}" (instanceable = true\n references = @./rock.usda@) {{}}\n' for number in range(50))
    (tmp_path / "stage.usda").write_text(
        "#usda 1.0\n(subLayers = [@./layer.usda@])\n"
        'class "_kind" {\n double y = 2\n }\n'
        f'def Xform "World" {{\n{many}'
        'def "a" (references = @./rock.usda@\n inherits = </_kind>) {}\n'
        'def "b" (references = </World/a/M>) {}\n'
        'def "c" (variants = { string v = "one" }\n prepend variantSets = "v") {\n'
        '  variantSet "v" = {\n "one" (references = </World/a>) {\n }\n "two" {\n def "d" {}\n }\n }\n }\n}\n'
    )
    mesh = load_mesh(tmp_path / "stage.usda")
    assert (mesh.face_count, mesh.warnings) == (53 * 4, ())
    assert isinstance(open_stage(tmp_path / "stage.usda"), Usd.Stage)
