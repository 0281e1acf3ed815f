"""Stages in Newton, which continues from their start."""

import warnings
from pathlib import Path

import numpy as np
import pytest
from meshes import cube, fans, quad_sphere
from scipy.spatial.transform import Rotation

from balloon_warp import Balloon, Body, Ground, Inflation, Material, Obstacle, Scene, Simulator, Sphere, animate

pytest.importorskip("newton_usd_schemas")
newton = pytest.importorskip("newton")

RATE = 100.0
THICKNESS, MODULUS = 2.0e-4, 3.0 * 3.3e5
AS_NEWTON_HAS_IT = 0.499
"""Poisson's ratio of incompressible materials"""
KNOWN = ("authored velocities are not imported", "is incompressible")
"""warnings that Newton 1.8 gives of latex, and must"""
OF_SPRINGS = (*KNOWN, "no valid surface thickness", "surfaceShearStiffness is not applied")


def everything(up_axis: str) -> Scene:
    """Return a scene of a latex ball, whose file is in centimeters, above one rigid thing of each kind."""
    ball = {"mesh": fans(quad_sphere(3, 5.0)), "unit": "cm", "name": "ball", "material": Material(preset="latex")}
    moving = {"velocity": (1.0, 2.0, 3.0), "angular_velocity": (0.0, 4.0, 1.0)}
    balloon = Balloon(**ball, **moving, position=(0, 0.5, 0.1), inflation=Inflation(kind="pressure", pressure=10.0))
    turned = {"rotation": (20.0, 30.0, 40.0)}
    things = {
        "sphere": [Sphere(position=(2, 3, 1), mass=0.3, **moving), Sphere(position=(4, 3, 1), start=0.01)],
        "body": [Body(size=(0.2, 0.3, 0.4), position=(-2, 3, 1), mass=2.5, **turned, **moving)],
        "obstacle": [
            Obstacle(mesh=cube(), position=(0, 5, 0), name="still", friction=0.25, **turned),
            Obstacle(position=(0, -3, 0), name="moved", motion=[[0.0, [0, 0, 0]], [0.1, [1, 0, 0]]]),
        ],
        "ground": Ground(height=-9.0),
    }
    return Scene(balloon=[balloon], up_axis=up_axis, frames=2, frames_per_second=RATE, **things)


def taken(scene: Scene, folder: Path) -> tuple:
    """Return Newton's builder for a stage, the places of balloons in it, and its warnings."""
    path = folder / "stage.usdc"
    animate(scene, path, device="cpu")
    builder = newton.ModelBuilder(up_axis=scene.up_axis)
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        found = builder.add_usd(str(path), return_deformable_results=True)
    return builder, found, [str(each.message) for each in heard if each.category.__module__.startswith("newton")]


@pytest.fixture(scope="module", params=["Y", "Z"])
def all_of_it(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> tuple:
    scene = everything(request.param)
    return scene, *taken(scene, tmp_path_factory.mktemp("newton"))


def test_latex_is_latex(all_of_it: tuple):
    scene, builder, found, said = all_of_it
    frame, shape = Simulator(scene, "cpu").read_frame(), Simulator(scene, "cpu").model.shapes[0]
    first, end = found["path_cloth_map"]["/World/ball"]["particle"]
    np.testing.assert_allclose(builder.particle_q[first:end], frame.points[0], atol=1e-6)
    np.testing.assert_allclose(np.array(builder.particle_radius[first:end]), 0.5 * THICKNESS, rtol=1e-6)
    mass = 940.0 * THICKNESS * shape.membrane.areas.sum()
    np.testing.assert_allclose(builder.particle_mass[first:end], mass * shape.mass_share, rtol=1e-5)
    assert builder.tri_count == shape.mesh.face_count
    plane = MODULUS / (1.0 - AS_NEWTON_HAS_IT**2)
    np.testing.assert_allclose([each[0] for each in builder.tri_materials], plane * THICKNESS, rtol=1e-5)
    bend = [each[0] for each in builder.edge_bending_properties]
    np.testing.assert_allclose(bend, plane * THICKNESS**3 / 12.0, rtol=1e-5)
    strange = [each for each in said if not any(known in each for known in KNOWN)]
    assert strange == []


def test_what_is_rigid_is_where_it_was_and_moves_as_it_did(all_of_it: tuple):
    scene, builder, found, _ = all_of_it
    sphere, box, moved = (
        found["path_body_map"][f"/World/{name}"] for name in ("Spheres/Sphere_0", "Bodies/box", "Obstacles/moved")
    )
    assert builder.body_count == 3, "what appears later is not there yet"
    assert (builder.body_mass[sphere], builder.body_mass[box]) == pytest.approx((0.3, 2.5))
    for body, said in ((sphere, scene.sphere[0]), (box, scene.body[0])):
        np.testing.assert_allclose(builder.body_q[body][:3], said.position, atol=1e-6)
        velocity = (*said.velocity, *said.angular_velocity)
        np.testing.assert_allclose(builder.body_qd[body], velocity, rtol=1e-5, atol=1e-6)
    turn = Rotation.from_quat(builder.body_q[box][3:]).as_matrix()
    np.testing.assert_allclose(turn, Rotation.from_euler("xyz", (20, 30, 40), degrees=True).as_matrix(), atol=1e-6)
    np.testing.assert_allclose(builder.body_q[moved][:3], (0, -3, 0), atol=1e-6)
    assert builder.body_flags[moved] & newton.BodyFlags.KINEMATIC


def test_what_stays_is_hit(all_of_it: tuple):
    _, builder, found, _ = all_of_it
    for path, friction in (("Ground", 0.5), ("Obstacles/still", 0.25), ("Obstacles/moved", 0.5), ("Bodies/box", 0.5)):
        shape = found["path_shape_map"][f"/World/{path}"]
        assert builder.shape_flags[shape] & newton.ShapeFlags.COLLIDE_SHAPES, path
        assert builder.shape_material_mu[shape] == pytest.approx(friction), path


def test_springs_are_the_sheet_that_they_make(tmp_path: Path):
    scene = Scene(balloon=[Balloon(mesh=quad_sphere(3), name="net", mass=0.2)], frames=1)
    builder, found, said = taken(scene, tmp_path)
    material = found["path_cloth_attrs"]["/World/net"]["material"]
    assert builder.tri_materials[0][0] == pytest.approx(material["surfaceStretchStiffness"])
    assert material["surfaceStretchStiffness"] == pytest.approx(3.0 * material["surfaceShearStiffness"], rel=1e-6)
    assert sum(builder.particle_mass) == pytest.approx(0.2, rel=1e-5)
    strange = [each for each in said if not any(known in each for known in OF_SPRINGS)]
    assert strange == []
