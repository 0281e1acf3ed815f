"""Obstacles, bodies and materials in the stage; shapes of other programs, instances and time codes."""

import os
import zipfile
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from exported import animated, assert_valid, at_start
from meshes import cube, fans, grid, quad_sphere
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics, UsdShade
from render_stages import read_stage
from scipy.spatial.transform import Rotation
from test_mesh_files import add_mesh, move

from balloon_warp import Frame, Simulator, animate, check_stage, export_stage, load_mesh, run_batch
from balloon_warp.errors import InputError
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import signed_volume
from balloon_warp.mesh.usd_open import open_stage
from balloon_warp.mesh.usd_stage import read_motions
from balloon_warp.model import build_model, plan_model
from balloon_warp.model.materials import SheetStiffness, sheet_of_springs
from balloon_warp.model.obstacles import obstacle_motion
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Balloon, Body, Change, Inflation, Material, Obstacle, Scene, Stiffness
from balloon_warp.studio.parts import Animation
from balloon_warp.studio.render.stage_reader import RenderStage
from balloon_warp.studio.render.view import frame_action

FRAMES = 4
BESIDE_A_BALL: dict[str, Any] = {"balloon": [Balloon(mesh=quad_sphere(3, 0.5))], "frames": FRAMES, "faces": False}
BESIDE_A_BALL |= {"frames_per_second": 30}
MOTION = [(0.0, (0.0, 0.0, 0.0)), (0.1, (0.5, 0.0, 0.25), (90.0, 0.0, 30.0))]
PATHS = {
    "obstacles": [f"/World/Obstacles/{name}" for name in ("box", "capsule", "plane", "a_tile", "cap")],
    "bodies": [f"/World/Bodies/{name}" for name in ("box", "rod", "mesh", "mesh_1")],
}


def obstacles(**fields) -> Scene:
    """Return a small balloon above one obstacle of each shape, two of them moving."""
    things = [
        Obstacle(size=(1.0, 0.2, 0.4), position=(0.0, -2.0, 0.0), rotation=(0.0, 30.0, 0.0), color=(0.1, 0.2, 0.3)),
        Obstacle(shape="capsule", radius=0.2, length=0.5, position=(1.5, 0.0, 0.0), motion=MOTION),
        Obstacle(shape="plane", position=(0.0, -3.0, 0.0), rotation=(10.0, 0.0, 0.0)),
        Obstacle(mesh=cube(), scale=0.3, position=(-2.0, 0.0, 0.0), name="a tile"),
        Obstacle(mesh=grid(2, 2), position=(3.0, 0.0, 0.0), motion=MOTION, name="cap"),
    ]
    return Scene(**BESIDE_A_BALL | {"obstacle": things} | fields)


def bodies(**fields) -> Scene:
    """Return a small balloon beside one body of each shape, turning."""
    things = [
        Body(size=(0.2, 0.3, 0.4), position=(2, 1, 0), angular_velocity=(1, 2, 3), mass=2.5, color=(0.1, 0.2, 0.3)),
        Body(radius=0.1, length=0.5, position=(-2, 1, 0), rotation=(40, 0, 20), name="rod", velocity=(0, 1, 0)),
        Body(mesh=quad_sphere(3, 0.5), scale=0.5, position=(0, 3, 0), density=100.0, rotation=(0, 30, 0)),
        Body(mesh=grid(2, 3), position=(0, 5, 0), thickness=0.05),
    ]
    return Scene(**BESIDE_A_BALL | {"body": things} | fields)


SCENES = {"obstacles": obstacles, "bodies": bodies}


def placed(stage: Usd.Stage, path: str, frame: float) -> np.ndarray:
    """Return the matrix that takes a prim's points, as columns, to the world."""
    return np.array(UsdGeom.XformCache(frame).GetLocalToWorldTransform(stage.GetPrimAtPath(path))).T


def expected_matrix(pose: np.ndarray) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = Rotation.from_quat(pose[3:]).as_matrix(), pose[:3]
    return matrix


def frames_of(kind: str) -> list[Frame]:
    """Return the frames of the simulation."""
    return list(Simulator(SCENES[kind](), "cpu").run())


def poses(kind: str, frame: Frame) -> np.ndarray:
    return frame.obstacle_poses if kind == "obstacles" else frame.body_poses


@pytest.fixture(scope="module")
def file_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Return a function that makes a stage of a kind of solids, once."""

    @cache
    def made(kind: str) -> Path:
        path = tmp_path_factory.mktemp("stage") / f"{kind}.usdc"
        animate(SCENES[kind](), path, device="cpu")
        return path

    return made


@pytest.fixture
def stage(file_of: Callable[[str], Path]) -> Usd.Stage:
    return Usd.Stage.Open(str(file_of("obstacles")))


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("kind", ["obstacles", pytest.param("bodies", marks=pytest.mark.full)])
def test_every_validator_passes(kind: str, up_axis: str, tmp_path: Path):
    box, capsule, _, *meshes = obstacles().obstacle
    some = {"obstacle": [box, capsule, *meshes]} if kind == "obstacles" else {}  # no plane through the balloon
    assert_valid(animated(SCENES[kind](up_axis=up_axis, frames=1, **some), tmp_path / "stage.usda"))


def test_each_is_a_gprim_of_its_shape(stage: Usd.Stage):
    prims = stage.GetPrimAtPath("/World/Obstacles").GetChildren()
    assert [str(prim.GetPath()) for prim in prims] == PATHS["obstacles"]
    assert [str(prim.GetTypeName()) for prim in prims] == ["Mesh", "Capsule", "Mesh", "Mesh", "Mesh"]
    for prim in prims:
        boundable, name = UsdGeom.Boundable(prim), prim.GetName()
        computed = UsdGeom.Boundable.ComputeExtentFromPlugins(boundable, Usd.TimeCode(0))
        np.testing.assert_allclose(boundable.GetExtentAttr().Get(), computed, atol=1e-6)
        material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
        (shown,) = UsdGeom.Gprim(prim).GetDisplayColorAttr().Get()
        assert material.ComputeSurfaceSource()[0].GetInput("diffuseColor").Get() == shown
        animated = [attribute.GetName() for attribute in prim.GetAttributes() if attribute.GetNumTimeSamples()]
        assert animated == (["xformOp:orient", "xformOp:translate"] if name in ("capsule", "cap") else [])
        if mesh := UsdGeom.Mesh(prim):
            assert mesh.GetSubdivisionSchemeAttr().Get() == "none"
    assert Gf.IsClose(UsdGeom.Gprim(prims[0]).GetDisplayColorAttr().Get()[0], Gf.Vec3f(0.1, 0.2, 0.3), 1e-6)


@pytest.mark.parametrize("kind", ["obstacles", pytest.param("bodies", marks=pytest.mark.full)])
def test_they_stand_where_they_are_simulated(kind: str, file_of: Callable[[str], Path]):
    stage = Usd.Stage.Open(str(file_of(kind)))
    for frame in frames_of(kind):
        for path, pose in zip(PATHS[kind], poses(kind, frame), strict=True):
            matrix = placed(stage, path, frame.number)
            matrix[:3, :3] /= np.linalg.norm(matrix[:3, :3], axis=0)  # the size of a box
            np.testing.assert_allclose(matrix, expected_matrix(pose), atol=5e-6)


def test_an_obstacle_goes_where_its_keyframes_say():
    turned = expected_matrix(frames_of("obstacles")[-1].obstacle_poses[1])
    np.testing.assert_allclose(turned[:3, 3], [2.0, 0.0, 0.25], atol=1e-6)
    rotation = Rotation.from_euler("xyz", (90, 0, 30), degrees=True).as_matrix()
    np.testing.assert_allclose(turned[:3, :3], rotation, atol=1e-6)


def test_a_plane_is_drawn_below_the_balloons(stage: Usd.Stage):
    matrix = placed(stage, "/World/Obstacles/plane", 0)
    corners = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/World/Obstacles/plane")).GetPointsAttr().Get())
    normal = matrix[:3, :3] @ np.cross(corners[1] - corners[0], corners[2] - corners[1])
    normal /= np.linalg.norm(normal)
    np.testing.assert_allclose(normal, [0.0, np.cos(np.radians(10)), np.sin(np.radians(10))], atol=1e-6)
    middle = matrix[:3, :3] @ corners.mean(axis=0) + matrix[:3, 3]
    np.testing.assert_allclose(np.cross(middle, normal), 0.0, atol=1e-5)  # below the origin, where the balloon is
    assert middle @ normal == pytest.approx(-3.0 * normal[1], rel=1e-6)


@pytest.mark.full
def test_a_change_moves_an_obstacle(tmp_path):
    change = [Change(time=2 / 30, set={"obstacle.0.position": (0.0, -2.5, 0.0)})]
    scene = obstacles(change=change, obstacle=[obstacles().obstacle[0], obstacles().obstacle[3]])
    stage = animated(scene, tmp_path / "change.usda")
    heights = [placed(stage, "/World/Obstacles/box", frame)[1, 3] for frame in range(FRAMES + 1)]
    assert heights == [-2.0, -2.0, -2.0, -2.5, -2.5]
    box, tile = (UsdGeom.Xformable(prim) for prim in stage.GetPrimAtPath("/World/Obstacles").GetChildren())
    assert (box.TransformMightBeTimeVarying(), tile.TransformMightBeTimeVarying()) == (True, False)


def test_worlds_of_a_batch_share_shapes_and_have_places_of_their_own(tmp_path):
    heights = [-2.0, -2.5, -3.0]
    vary = {"obstacle.0.position.1": heights, "obstacle.1.position.0": [1.5, 1.75, 2.0]}
    run_batch(obstacles(), tmp_path, 3, vary, export=[0, 2], device="cpu")
    stage = Usd.Stage.Open(str(tmp_path / "worlds.usdc"))
    assert_valid(stage)
    frames = list(Simulator(obstacles(), "cpu").run())
    for world in (0, 2):
        shift = placed(stage, f"/World/World_{world}", 0)[:3, 3]
        for frame in frames:
            poses = frame.obstacle_poses.copy()
            poses[0, 1], poses[1, 0] = heights[world], poses[1, 0] + 0.25 * world
            for number, name in ((1, "capsule"), (2, "plane"), (4, "cap")):
                matrix = expected_matrix(poses[number])
                matrix[:3, 3] += shift
                path = f"/World/World_{world}/{name}"
                np.testing.assert_allclose(placed(stage, path, frame.number), matrix, atol=1e-5)
            assert placed(stage, f"/World/World_{world}/box", frame.number)[1, 3] == pytest.approx(heights[world])
    samples = [
        [prim.GetAttribute(f"xformOp:{op}").GetNumTimeSamples() for op in ("translate", "orient")]
        for prim in (stage.GetPrimAtPath(f"/World/World_2/{name}") for name in ("box", "capsule"))
    ]
    assert samples == [[0, 0], [FRAMES + 1, FRAMES + 1]]


SIZES = {"obstacles": ((0.5, 0.1, 0.2), 0.25, 0.2), "bodies": ((0.1, 0.15, 0.2), 0.25, 0.1)}
"""half sides of the box, half length and radius of the capsule"""


@pytest.mark.parametrize("kind", ["obstacles", pytest.param("bodies", marks=pytest.mark.full)])
def test_pictures_have_them_at_their_places(kind: str, file_of: Callable[[str], Path]):
    reader, (sides, half, round_one) = read_stage(file_of(kind)), SIZES[kind]
    for frame in frames_of(kind):
        box, rod = poses(kind, frame)[:2].astype(float)
        own = Rotation.from_quat(box[3:]).inv().apply(reader.points(frame.number)[1] - box[:3])
        np.testing.assert_allclose([-own.min(axis=0), own.max(axis=0)], np.tile(sides, (2, 1)), atol=1e-6)
        (begin,), (end,), (radius,) = reader.capsules(frame.number)
        up = Rotation.from_quat(rod[3:]).apply((0, half, 0))
        np.testing.assert_allclose([begin, end], [rod[:3] - up, rod[:3] + up], atol=1e-6)
        assert radius == pytest.approx(round_one)


def test_pictures_know_their_edges_and_colors(file_of: Callable[[str], Path]):
    reader = read_stage(file_of("obstacles"))
    box, mesh = reader.meshes[1], reader.meshes[3]
    assert (box.soft, mesh.soft, reader.meshes[0].soft) == (False, False, True)
    vertices, normals = box.surface.place(reader.points(0)[1])
    assert ((vertices - reader.points(0)[1].mean(axis=0)) * normals).sum(axis=1).min() > 0.0  # they look outward
    np.testing.assert_allclose(box.cover.colors, np.tile([0.1, 0.2, 0.3], (len(box.cover.colors), 1)), atol=1e-6)


def test_the_camera_frames_the_balloons_and_not_a_plane(file_of: Callable[[str], Path]):
    reader = read_stage(file_of("obstacles"))
    framing = frame_action([(reader, frame) for frame in range(FRAMES + 1)], 16 / 9)
    assert framing.size < 8.0  # from the tile to the sheet
    assert max(np.ptp(points, axis=0).max() for points in reader.points(0)) > 30.0


def test_the_stage_says_what_they_weigh(tmp_path: Path):
    stage = at_start(bodies(), tmp_path / "start.usda")
    box = UsdPhysics.MassAPI(stage.GetPrimAtPath("/World/Bodies/box"))
    assert box.GetMassAttr().Get() == 2.5
    sides = 2.5 / 12.0 * np.array([0.3**2 + 0.4**2, 0.2**2 + 0.4**2, 0.2**2 + 0.3**2])
    np.testing.assert_allclose(sorted(box.GetDiagonalInertiaAttr().Get()), sorted(sides), rtol=1e-6)
    q = box.GetPrincipalAxesAttr().Get()
    axes = Rotation.from_quat([*q.GetImaginary(), q.GetReal()]).as_matrix()
    tensor = axes @ np.diag(box.GetDiagonalInertiaAttr().Get()) @ axes.T
    np.testing.assert_allclose(tensor, np.diag(sides), atol=1e-6)


RUBBERS = {
    "latex": 3.3e5,
    "foil": 1.5e9,
    "nylon": 8.0e8,
    "natural_rubber_treloar": 0.5 * (6.3e5 * 1.3 + 1.2e3 * 5.0 + 1.0e4 * 2.0),
}
"""presets, and the shear moduli at rest that are published of them [Pa]"""


def made_of(material: Material, **fields) -> Scene:
    """Return a ball of 20 cm in a file of centimeters, which flies and turns, in a scene with Z up."""
    ball = {"mesh": quad_sphere(2, 10.0), "unit": "cm", "name": "ball", "velocity": (1, 2, 3)}
    balloon = Balloon(**ball | {"angular_velocity": (0, 1, 4), "material": material, "friction": 0.7} | fields)
    return Scene(balloon=[balloon], up_axis="Z", frames=1, frames_per_second=1000)


def physics_of(stage: Usd.Stage) -> Usd.Prim:
    """Return the material that is bound to the ball for the purpose of physics."""
    prim = stage.GetPrimAtPath("/World/ball")
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial("physics")
    assert material.GetPath() != UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()[0].GetPath()
    return material.GetPrim()


@pytest.mark.full
@pytest.mark.parametrize("preset", RUBBERS)
def test_rubber_and_film_are_as_stiff_and_thick_as_the_scene_says(tmp_path: Path, preset: str):
    material = Material(preset=preset)
    if material.bound_on_strain:
        material = Material(preset=preset, exact=True)
    stage = animated(made_of(material, inflation=Inflation(kind="pressure", pressure=1.0)), tmp_path / "stage.usda")
    substance, prim = physics_of(stage), stage.GetPrimAtPath("/World/ball")
    assert "PhysicsSurfaceDeformableMaterialAPI" in substance.GetPrimTypeInfo().GetAppliedAPISchemas()
    assert substance.GetAttribute("physics:youngsModulus").Get() == pytest.approx(3.0 * RUBBERS[preset], rel=1e-6)
    assert substance.GetAttribute("physics:poissonsRatio").Get() == 0.5
    assert UsdPhysics.MaterialAPI(substance).GetDensityAttr().Get() == material.value("density")
    assert UsdPhysics.MaterialAPI(substance).GetDynamicFrictionAttr().Get() == pytest.approx(0.7)
    np.testing.assert_allclose(prim.GetAttribute("physics:thicknesses").Get(), [material.value("thickness")])
    assert prim.GetAttribute("physics:thicknesses:elementType").Get() == "constant"
    assert not prim.HasAttribute("physics:mass"), "it follows, and what is said twice may differ"
    assert_valid(stage)


def test_a_skin_that_is_not_as_thick_everywhere_says_so_of_each_point(tmp_path: Path):
    weights = np.linspace(1.0, 3.0, quad_sphere(2).vertex_count).tolist()
    material = Material(preset="latex", weights=weights)
    stage = at_start(made_of(material, inflation=Inflation(kind="pressure", pressure=1.0)), tmp_path / "stage.usda")
    prim = stage.GetPrimAtPath("/World/ball")
    np.testing.assert_allclose(prim.GetAttribute("physics:thicknesses").Get(), 2e-4 * np.array(weights), rtol=1e-6)
    assert prim.GetAttribute("physics:thicknesses:elementType").Get() == "point"


def test_velocities_stand_where_points_do(tmp_path: Path):
    scene = made_of(Material(), fixed=[3])
    stage = animated(scene, tmp_path / "stage.usda")
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/World/ball"))
    frame = Simulator(scene, "cpu").read_frame()
    np.testing.assert_allclose(mesh.GetPointsAttr().Get(), frame.points[0], atol=1e-7)
    np.testing.assert_allclose(mesh.GetVelocitiesAttr().Get(), frame.velocities[0], atol=1e-6)
    assert len(mesh.GetVelocitiesAttr().GetTimeSamples()) == 2


def test_springs_say_their_sheet_and_their_masses(tmp_path: Path):
    stage = animated(made_of(Material(), mass=0.2), tmp_path / "stage.usda")
    substance, prim = physics_of(stage), stage.GetPrimAtPath("/World/ball")
    sheet = (substance.GetAttribute(f"physics:surface{each}Stiffness") for each in ("Stretch", "Shear", "Bend"))
    stretch, shear, bend = (each.Get() for each in sheet)
    assert stretch == pytest.approx(3.0 * shear)
    assert shear > 0.0
    assert bend == 0.0
    assert not UsdPhysics.MaterialAPI(substance).GetDensityAttr().HasAuthoredValue()
    for absent in ("youngsModulus", "poissonsRatio"):
        assert not substance.HasAttribute(f"physics:{absent}")
    assert not prim.HasAttribute("physics:thicknesses"), "springs have none"
    assert prim.GetAttribute("physics:masses:elementType").Get() == "point"
    assert sum(prim.GetAttribute("physics:masses").Get()) == pytest.approx(0.2, rel=1e-5)
    assert prim.GetAttribute("physics:mass").Get() == pytest.approx(0.2)
    stage = at_start(made_of(Material(), mass=0.2, fixed=[0]), tmp_path / "held.usda")
    held = stage.GetPrimAtPath("/World/ball")
    assert not held.HasAttribute("physics:masses"), "what is fixed has none"
    assert held.GetAttribute("physics:mass").Get() == pytest.approx(0.2)


@pytest.mark.parametrize("triangles", [False, True])
def test_the_sheet_swells_as_its_springs(triangles: bool):
    mesh = fans(grid(9, 7)) if triangles else grid(9, 7)
    shape, sheet, _ = _sheet(mesh, Stiffness(structural=13.0, shear=5.0, flexion=3.0))
    constants = np.array([13.0, 5.0, 3.0])[shape.springs.kind]
    strain = 1e-3
    of_springs = 0.5 * (constants * (strain * shape.springs.rest_lengths) ** 2).sum()
    assert (sheet.stretch + sheet.shear) * strain**2 * shape.area == pytest.approx(of_springs, rel=1e-6)


def test_the_sheet_bends_as_its_hinges():
    """The sheet has the bending energy of its hinges, curved both ways as a part of a large sphere."""
    shape, sheet, torsion = _sheet(grid(12, 12), Stiffness(torsion=0.4))
    points, radius = shape.mesh.points, 1000.0
    flat = np.ptp(points, axis=0).argmin()
    bowl = points.copy()
    bowl[:, flat] += (np.delete(points, flat, axis=1) ** 2).sum(axis=1) / (2.0 * radius)
    of_hinges = 0.5 * torsion * (shape.hinges.angles(bowl) ** 2).sum()
    of_sheet = sheet.bend * (1.0 + 1.0 / 3.0) / radius**2 * shape.area
    assert of_sheet == pytest.approx(of_hinges, rel=1e-3)


def _sheet(mesh: Any, stiffness: Stiffness) -> tuple[BalloonShape, SheetStiffness, float]:
    """Return a shape, its sheet, and its torsion."""
    model = build_model(Scene(balloon=[Balloon(mesh=mesh, stiffness=stiffness)]), "cpu")
    parameters = {name: values.numpy() for name, values in model.parameters.items()}
    sheet = sheet_of_springs(model.shapes[0], parameters, 0)
    assert sheet is not None
    return model.shapes[0], sheet, stiffness.torsion


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
def stage_files(tmp_path: Path) -> Files:
    return Files(tmp_path / "stage.usda")


ROUND = np.pi
SHAPES = {
    "Cube": ({"size": 2.0}, 8.0, (2, 2, 2)),
    "Sphere": ({"radius": 0.5}, ROUND / 6.0, (1, 1, 1)),
    "Cylinder": ({"radius": 0.5, "height": 3.0, "axis": "X"}, ROUND * 0.75, (3, 1, 1)),
    "Cylinder_1": ({"radiusTop": 0.25, "radiusBottom": 0.5, "height": 3.0, "axis": "Y"}, ROUND * 7 / 16, (1, 3, 1)),
    "Cone": ({"radius": 0.5, "height": 3.0}, ROUND * 0.25, (1, 1, 3)),
    "Capsule": ({"radius": 0.5, "height": 2.0}, ROUND * (0.5 + 1.0 / 6.0), (1, 1, 3)),
    "Plane": ({"width": 2.0, "length": 4.0, "axis": "Y"}, 0.0, (2, 0, 4)),
}


@pytest.mark.parametrize("kind", SHAPES)
def test_a_shape_is_a_mesh_for_all_that_read_stages(stage_files: Files, kind: str):
    sizes, volume, box = SHAPES[kind]
    prim = stage_files.stage.DefinePrim("/Room/Thing", kind)
    for name, value in sizes.items():
        prim.GetAttribute(name).Set(value)
    UsdGeom.Gprim(prim).CreateDisplayColorAttr([(1.0, 0.0, 0.0)])
    prim.CreateAttribute("orientation", Sdf.ValueTypeNames.Token).Set("leftHanded")
    move(UsdGeom.Xformable(prim), 5.0)
    mesh = stage_files.read()
    assert signed_volume(mesh) == pytest.approx(volume, rel=0.02)
    np.testing.assert_allclose(np.ptp(mesh.points, axis=0), box, atol=1e-6)
    assert mesh.points.mean(axis=0)[0] == pytest.approx(5.0, abs=0.2)
    assert (mesh.name, mesh.warnings) == ("Thing", ())
    assert mesh.looks is not None
    assert mesh.looks.materials[0].color == (1.0, 0.0, 0.0)
    drawn = RenderStage(stage_files.path)
    drawn.read_prims(0.0)
    assert len(drawn.meshes) + len(drawn.rounds) == 1
    animation = Animation(stage_files.path)
    (part,) = animation.parts
    np.testing.assert_allclose(part.points(0), mesh.points, atol=1e-6)
    assert part.color == (1.0, 0.0, 0.0)


@pytest.mark.parametrize("kind", ["Cube", "Sphere"])
def test_check_finds_what_crosses_a_shape(stage_files: Files, kind: str):
    ball = add_mesh(stage_files.stage, "/Ball", cube())
    for frame in (0, 1):
        ball.GetPointsAttr().Set(ball.GetPointsAttr().Get(), frame)
    stage_files.stage.DefinePrim("/Table", kind)
    (crossing, _) = check_stage(stage_files.saved(), device="cpu").crossings
    assert "balloon Ball" in (crossing.first, crossing.second)
    assert crossing.depth > 0.2


def test_an_ellipsoid_is_one_in_pictures(stage_files: Files):
    prim = UsdGeom.Sphere.Define(stage_files.stage, "/Egg")
    prim.AddScaleOp().Set(Gf.Vec3f(1, 2, 1))
    drawn = RenderStage(stage_files.saved())
    drawn.read_prims(0.0)
    assert not drawn.rounds
    np.testing.assert_allclose(np.ptp(drawn.points(0.0)[0], axis=0), (2, 4, 2), atol=1e-6)


def test_a_shape_inside_an_instance_is_found(stage_files: Files):
    stage_files.stage.CreateClassPrim("/prototype")
    stage_files.stage.DefinePrim("/prototype/deeper/cube", "Cube")
    for x, name in enumerate("ab"):
        instance = UsdGeom.Xform.Define(stage_files.stage, f"/{name}")
        instance.GetPrim().GetReferences().AddInternalReference("/prototype")
        instance.GetPrim().SetInstanceable(True)
        move(instance, 5.0 * x)
    mesh = stage_files.read()
    assert mesh.face_count == 12
    assert np.ptp(mesh.points, axis=0)[0] == 7.0


@pytest.mark.parametrize(
    ("value", "said"), [(float("nan"), r"/Ball.radius is nan; expected a finite"), (-1.0, "is -1; expected a finite")]
)
def test_a_size_that_is_none_gets_a_sentence(stage_files: Files, value: float, said: str):
    UsdGeom.Sphere.Define(stage_files.stage, "/Ball").CreateRadiusAttr(value)
    with pytest.raises(InputError, match=said):
        stage_files.read()


@pytest.mark.parametrize("kind", ["NurbsPatch", "Points", "BasisCurves"])
def test_what_cannot_be_taken_is_named(stage_files: Files, kind: str):
    """Curves are drawn if they are linear, which these are not."""
    add_mesh(stage_files.stage, "/Room/Floor", cube())
    stage_files.stage.DefinePrim("/Room/Table", kind)
    UsdGeom.Imageable(stage_files.stage.DefinePrim("/Room/Hidden", kind)).MakeInvisible()
    notes = [*stage_files.read().warnings, *stage_files.read("/Room").warnings]
    RenderStage(stage_files.path, on_note=notes.append)
    check_stage(stage_files.path, device="cpu", on_note=notes.append)
    export_stage(stage_files.path, stage_files.path.with_suffix(".glb"), on_note=notes.append)
    assert len(notes) >= 5
    assert all(f"Left out of the stage: /Room/Table ({kind}" in each for each in notes[:5])
    assert not any("Hidden" in each for each in notes)
    stage_files.stage.RemovePrim("/Room/Floor")
    with pytest.raises(InputError, match=rf"has no mesh .*/Room/Table \({kind}\)"):
        stage_files.read()


def corners(mesh: PolygonMesh) -> NDArray[np.float64]:
    """Return the least corner of each cube that a mesh has, shape (n, 3)."""
    return mesh.points.reshape(-1, 8, 3).min(axis=1)


def test_a_point_instancer_is_what_it_scatters(stage_files: Files):
    instancer = stage_files.scatter("/Set/Rocks", [(0, 0, 0), (2, 0, 0), (4, 0, 0), (6, 0, 0)])
    instancer.CreateScalesAttr([(1, 1, 1), (1, 2, 1), (1, 1, 1), (1, 1, 1)])
    instancer.CreateInvisibleIdsAttr([2])
    move(UsdGeom.Xform.Define(stage_files.stage, "/Set"), 10.0)
    mesh = stage_files.read()
    np.testing.assert_allclose(corners(mesh), cube().points.min(axis=0) + [(10, 0, 0), (12, 0, 0), (16, 0, 0)])
    assert mesh.points[8:16, 1].min() == 2.0 * cube().points[:, 1].min()
    assert mesh.warnings == ()
    assert stage_files.read("/Set/Rocks/Rock_1").face_count == 6
    assert len(Animation(stage_files.path).parts) == 3
    assert len(check_stage(stage_files.path, device="cpu").things) == 3


def test_instances_of_instances_of_shapes_elsewhere_are_found(stage_files: Files):
    stage_files.stage.CreateClassPrim("/Kinds")
    stage_files.stage.DefinePrim("/Kinds/Box", "Cube")
    stage_files.scatter("/Kinds/Pair", [(0, 0, 0), (0, 5, 0)], box="/Kinds/Box")
    stage_files.scatter("/Set", [(0, 0, 0), (7, 0, 0)], pair="/Kinds/Pair")
    np.testing.assert_allclose(corners(stage_files.read()) + 1.0, [(0, 0, 0), (0, 5, 0), (7, 0, 0), (7, 5, 0)])


def test_instances_move_apart(stage_files: Files):
    instancer = stage_files.scatter("/Rocks", [(0, 0, 0), (5, 0, 0)])
    for time in (0.0, 24.0):
        instancer.GetPositionsAttr().Set([(0, time, 0), (5, 2.0 * time, 0)], time)
    stage_files.stage.SetTimeCodesPerSecond(24.0)
    motions = read_motions(stage_files.saved(), None)
    assert [motion.matrices([1.0])[0, 1, 3] for motion in motions] == [24.0, 48.0]


@pytest.mark.parametrize(
    ("name", "value", "said"),
    [
        ("protoIndices", [0, 1], "protoIndices do not match its 1 prototypes"),
        ("positions", [(0, 0, 0)], "it places 0 instances of 2"),
    ],
)
def test_instances_that_do_not_fit_are_named(stage_files: Files, name: str, value: list, said: str):
    stage_files.scatter("/Rocks", [(0, 0, 0), (5, 0, 0)]).GetPrim().GetAttribute(name).Set(value)
    assert said in stage_files.read().warnings[0]


def test_a_converted_stage_keeps_its_shapes(stage_files: Files):
    stage_files.stage.DefinePrim("/Table", "Cube")
    stage_files.scatter("/Rocks", [(0, 0, 0), (5, 0, 0)])
    export_stage(stage_files.saved(), stage_files.path.with_name("out.usda"))
    kept = Usd.Stage.Open(str(stage_files.path.with_name("out.usda")))
    kinds = [kept.GetPrimAtPath(path).GetTypeName() for path in ("/Table", "/Rocks")]
    assert kinds == ["Cube", "PointInstancer"]


SECONDS = np.arange(25) / 24.0


def moving(path: Path, codes: np.ndarray, rate: float, where: np.ndarray = SECONDS, **told: float) -> Path:
    """Return a cube that moves along x, at these codes by these distances [m]: a meter a second by default."""
    stage_files = Files(path)
    stage_files.stage.SetTimeCodesPerSecond(rate)
    translation = add_mesh(stage_files.stage, "/cube", cube()).AddTranslateOp()
    for code, place in zip(codes.tolist(), where.tolist(), strict=True):
        translation.Set(Gf.Vec3d(place, 0.0, 0.0), code)
    for name, value in told.items():
        stage_files.stage.SetMetadata(name, value)
    return stage_files.saved()


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
        (24.0 * SECONDS, 24.0, {"startTimeCode": -1e7, "endTimeCode": 2e7}),  # wider than the samples
        (24.0 * SECONDS, 24.0, {"startTimeCode": 500.0, "endTimeCode": 600.0}),  # of other samples
        (0.5 + 24.0 * SECONDS, 24.0, {}),  # between codes
    ],
)
def test_frames_are_the_samples_own_times(tmp_path: Path, codes: np.ndarray, rate: float, told: dict[str, float]):
    times, places = times_and_places(moving(tmp_path / "cube.usda", codes, rate, **told))
    np.testing.assert_allclose(times, SECONDS, atol=1e-9)
    np.testing.assert_allclose(places, SECONDS, atol=1e-6)  # samples are shifted by a millionth of a frame


def test_a_range_narrower_than_the_samples_bounds_them_and_one_of_one_sample_is_a_frame(tmp_path: Path):
    path = moving(tmp_path / "still.usda", SECONDS[:1], 24.0, SECONDS[:1], startTimeCode=-1e7, endTimeCode=2e7)
    assert times_and_places(path) == ([0.0], [0.0])
    path = moving(tmp_path / "cube.usda", 24.0 * SECONDS, 24.0, startTimeCode=6.0, endTimeCode=18.0)
    times, places = times_and_places(path)
    np.testing.assert_allclose(times, SECONDS[:13], atol=1e-9)
    np.testing.assert_allclose(places, SECONDS[6:19], atol=1e-9)


def test_keyframes_far_apart_are_shown_at_the_rate_that_the_stage_says(tmp_path: Path):
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
