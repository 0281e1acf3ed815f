"""Obstacles and free bodies in the stage, in pictures of it and in batches; and what balloons are made of, for programs
that go on simulating them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from meshes import cube, fans, grid, quad_sphere
from motion import animated, assert_valid
from pxr import Gf, Usd, UsdGeom, UsdPhysics, UsdShade
from render_stages import read_stage
from scipy.spatial.transform import Rotation
from trajectories import stepped

from balloon_warp import Frame, Simulator, StageWriter, animate, run_batch
from balloon_warp.model import build_model
from balloon_warp.model.materials import SheetStiffness, sheet_of_springs
from balloon_warp.model.shape import BalloonShape
from balloon_warp.scene import Balloon, Body, Change, Inflation, Material, Obstacle, Scene, Stiffness
from balloon_warp.studio.render.view import frame_action

FRAMES = 4
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
    fields = {"balloon": [Balloon(mesh=quad_sphere(3, 0.5))], "obstacle": things, "frames": FRAMES} | fields
    return Scene(frames_per_second=30, **fields)


def bodies(**fields) -> Scene:
    """Return a small balloon beside one body of each shape, turning."""
    things = [
        Body(size=(0.2, 0.3, 0.4), position=(2, 1, 0), angular_velocity=(1, 2, 3), mass=2.5, color=(0.1, 0.2, 0.3)),
        Body(radius=0.1, length=0.5, position=(-2, 1, 0), rotation=(40, 0, 20), name="rod", velocity=(0, 1, 0)),
        Body(mesh=quad_sphere(3, 0.5), scale=0.5, position=(0, 3, 0), density=100.0, rotation=(0, 30, 0)),
        Body(mesh=grid(2, 3), position=(0, 5, 0), thickness=0.05),
    ]
    table = {"balloon": [Balloon(mesh=quad_sphere(3, 0.5))], "body": things, "frames": FRAMES, "frames_per_second": 30}
    return Scene(**table | fields)


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
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return a stage of each kind of solids."""
    made = {kind: tmp_path_factory.mktemp("stage") / f"{kind}.usdc" for kind in SCENES}
    for kind, path in made.items():
        animate(SCENES[kind](), path, device="cpu")
    return made


@pytest.fixture
def stage(files: dict[str, Path]) -> Usd.Stage:
    return Usd.Stage.Open(str(files["obstacles"]))


@pytest.mark.parametrize("up_axis", ["Y", "Z"])
@pytest.mark.parametrize("kind", ["obstacles", pytest.param("bodies", marks=pytest.mark.full)])
def test_every_validator_passes(kind: str, up_axis: str, tmp_path: Path):
    some = {"obstacle": obstacles().obstacle[:2]} if kind == "obstacles" else {}  # no plane through the balloon
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
def test_they_stand_where_they_are_simulated(kind: str, files: dict[str, Path]):
    stage = Usd.Stage.Open(str(files[kind]))
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
def test_pictures_have_them_at_their_places(kind: str, files: dict[str, Path]):
    reader, (sides, half, round_one) = read_stage(files[kind]), SIZES[kind]
    for frame in frames_of(kind):
        box, rod = poses(kind, frame)[:2].astype(float)
        own = Rotation.from_quat(box[3:]).inv().apply(reader.points(frame.number)[1] - box[:3])
        np.testing.assert_allclose([-own.min(axis=0), own.max(axis=0)], np.tile(sides, (2, 1)), atol=1e-6)
        (begin,), (end,), (radius,) = reader.capsules(frame.number)
        up = Rotation.from_quat(rod[3:]).apply((0, half, 0))
        np.testing.assert_allclose([begin, end], [rod[:3] - up, rod[:3] + up], atol=1e-6)
        assert radius == pytest.approx(round_one)


def test_pictures_know_their_edges_and_colors(files: dict[str, Path]):
    reader = read_stage(files["obstacles"])
    box, mesh = reader.meshes[1], reader.meshes[3]
    assert (box.soft, mesh.soft, reader.meshes[0].soft) == (False, False, True)
    vertices, normals = box.surface.place(reader.points(0)[1])
    assert ((vertices - reader.points(0)[1].mean(axis=0)) * normals).sum(axis=1).min() > 0.0  # they look outward
    np.testing.assert_allclose(box.cover.colors, np.tile([0.1, 0.2, 0.3], (len(box.cover.colors), 1)), atol=1e-6)


def test_the_camera_frames_the_balloons_and_not_a_plane(files: dict[str, Path]):
    reader = read_stage(files["obstacles"])
    framing = frame_action([(reader, frame) for frame in range(FRAMES + 1)], 16 / 9)
    assert framing.size < 8.0  # from the tile to the sheet
    assert max(np.ptp(points, axis=0).max() for points in reader.points(0)) > 30.0


def test_a_recorded_frame_alone_has_them(tmp_path):
    frame = stepped(Simulator(obstacles(), "cpu"), 3).read_frame()
    with StageWriter(tmp_path / "one.usda", build_model(obstacles(), "cpu")) as writer:
        writer.write(frame)
    stage = Usd.Stage.Open(str(tmp_path / "one.usda"))
    found = placed(stage, "/World/Obstacles/capsule", 3)
    np.testing.assert_allclose(found, expected_matrix(frame.obstacle_poses[1]), atol=1e-6)


def test_the_stage_says_what_they_weigh(files: dict[str, Path]):
    stage = Usd.Stage.Open(str(files["bodies"]))
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


@pytest.mark.full
@pytest.mark.parametrize(
    "material", [Material(kind="gent", gent_limit=30.0), Material(kind="neo_hookean", shear_modulus=1e5)]
)
def test_a_law_of_ones_own_numbers_too(tmp_path: Path, material: Material):
    stage = animated(made_of(material, inflation=Inflation(kind="pressure", pressure=1.0)), tmp_path / "stage.usda")
    modulus = physics_of(stage).GetAttribute("physics:youngsModulus").Get()
    assert modulus == pytest.approx(3.0 * (material.shear_modulus or 3.3e5), rel=1e-6)


def test_a_skin_that_is_not_as_thick_everywhere_says_so_of_each_point(tmp_path: Path):
    weights = np.linspace(1.0, 3.0, quad_sphere(2).vertex_count).tolist()
    material = Material(preset="latex", weights=weights)
    stage = animated(made_of(material, inflation=Inflation(kind="pressure", pressure=1.0)), tmp_path / "stage.usda")
    prim = stage.GetPrimAtPath("/World/ball")
    np.testing.assert_allclose(prim.GetAttribute("physics:thicknesses").Get(), 2e-4 * np.array(weights), rtol=1e-6)
    assert prim.GetAttribute("physics:thicknesses:elementType").Get() == "point"


@pytest.mark.parametrize("fixed", [[], [3]])
def test_velocities_stand_where_points_do(tmp_path: Path, fixed: list[int]):
    """Velocities at the default time are those at the start, in the stage's meters and axes."""
    scene = made_of(Material(), fixed=fixed)
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


def test_what_is_fixed_has_no_mass_and_so_none_is_said_of_points(tmp_path: Path):
    stage = animated(made_of(Material(), fixed=[0]), tmp_path / "stage.usda")
    prim = stage.GetPrimAtPath("/World/ball")
    assert not prim.HasAttribute("physics:masses")
    assert prim.GetAttribute("physics:mass").Get() == pytest.approx(0.1)


@pytest.mark.parametrize("triangles", [False, True])
def test_the_sheet_swells_as_its_springs(triangles: bool):
    """The sheet has the energy of its springs in equibiaxial strain, whatever the mesh."""
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
