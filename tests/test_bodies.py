"""Free rigid bodies by themselves: mass, rotation, and refusals."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from meshes import grid, quad_sphere
from numpy.typing import NDArray
from rigid import EPSILON, SPACE, after, body_masses, body_state, kinetic, scene_of, started
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from balloon_warp.errors import InputError
from balloon_warp.model.bodies import shape_body
from balloon_warp.scene import Balloon, Body, Ground, Obstacle, Scene, Sphere
from balloon_warp.schedules.choose import schedule_named
from balloon_warp.schedules.gather import GatherSchedule
from balloon_warp.simulator import Simulator

pytestmark = pytest.mark.physics

TOP = Body(size=(0.6, 0.3, 0.15), mass=2.0, angular_velocity=(1.5, 8.0, 0.5))
"""one that turns about its middle axis, and so tumbles"""


def tumbled(device: str, substeps: int, frames: int = 100) -> tuple[float, NDArray[np.float64]]:
    """Return the largest error of the energy, over the energy, and the turn in the end."""
    simulator = started(device, TOP, **SPACE, substeps=substeps)
    energy, momenta, worst = kinetic(simulator), body_state(simulator, "momenta"), 0.0
    for _ in range(frames):
        simulator.step()
        worst = max(worst, abs(kinetic(simulator) - energy))
        np.testing.assert_array_equal(body_state(simulator, "momenta"), momenta)  # it is what is kept
    return worst / energy, body_state(simulator, "turns")[0]


def exact_turn(seconds: float) -> Rotation:
    """Return the turn of the top in the end, by Euler's equations in float64."""
    inertia = 2.0 * shape_body(0, TOP, scene_of(TOP)).inertia
    momentum = inertia @ TOP.angular_velocity

    def slope(_time: float, turn: NDArray[np.float64]) -> NDArray[np.float64]:
        rotation = Rotation.from_quat(turn)
        spin = rotation.apply(np.linalg.solve(inertia, rotation.inv().apply(momentum)))
        return 0.5 * np.append(spin * turn[3] + np.cross(spin, turn[:3]), -spin @ turn[:3])

    solved = solve_ivp(slope, (0.0, seconds), (0.0, 0.0, 0.0, 1.0), rtol=1e-11, atol=1e-12)
    return Rotation.from_quat(solved.y[:, -1])


@pytest.mark.full
def test_an_asymmetric_top_tumbles_and_keeps_angular_momentum_and_energy(device):
    """The midpoint rule converges at second order: half the step makes a quarter of the error, of the orientation and
    of the energy. The top turns about its middle axis, which is unstable: it has turned over by then."""
    errors, turns = zip(*[tumbled(device, substeps) for substeps in (1, 2, 4)], strict=True)
    exact = exact_turn(1.0)
    off = [(Rotation.from_quat(turn) * exact.inv()).magnitude() for turn in turns]
    for found in (errors, off):
        for coarse, fine in ((0, 1), (1, 2)):
            assert 3.0 < found[coarse] / found[fine] < 5.0
    assert errors[0] < 0.001
    assert off[0] < 0.01
    middle = [Rotation.from_quat(tumbled(device, 4, frames)[1]).apply((0, 1, 0))[1] for frames in (40, 60, 80, 100)]
    assert min(middle) < 0.0


def test_inertia_is_that_of_the_solid():
    """Inertia of boxes, capsules and meshes about their centers of mass agrees with trimesh's; a sheet's is that of a
    plate."""
    bent = quad_sphere(4, 0.5)
    bent = replace(bent, points=bent.points * (1.0, 0.5, 0.3) + (2.0, 1.0, -1.0))
    scene = scene_of(
        Body(size=(1.0, 2.0, 3.0)), Body(radius=0.2, length=0.7), Body(mesh=bent), Body(mesh=grid(3, 2), thickness=0.01)
    )
    shapes = [shape_body(number, body, scene) for number, body in enumerate(scene.body)]
    box = trimesh.creation.box((1.0, 2.0, 3.0))
    capsule = trimesh.creation.capsule(0.7, 0.2, count=[256, 256])
    capsule.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, (1, 0, 0)))
    solid = trimesh.Trimesh(bent.points, shapes[2].solid.triangles)
    for shape, expected, tolerance in zip(shapes, (box, capsule, solid), (1e-12, 1e-3, 1e-9), strict=False):
        assert shape.volume == pytest.approx(expected.volume, rel=tolerance)
        np.testing.assert_allclose(
            shape.inertia, expected.moment_inertia / expected.mass, rtol=tolerance, atol=tolerance
        )
    np.testing.assert_allclose(shapes[2].center, solid.center_mass)
    np.testing.assert_allclose(np.diag(shapes[3].inertia), (2**2 / 12, 3**2 / 12, (2**2 + 3**2) / 12))
    assert shapes[3].volume == pytest.approx(3 * 2 * 0.02)


def test_density_says_what_it_weighs(device):
    simulator = started(device, Body(size=(0.1, 0.2, 0.3), density=500.0), Body(size=(1, 1, 1), position=(5, 0, 0)))
    np.testing.assert_allclose(body_masses(simulator), (3.0, 1.0), rtol=EPSILON)


@pytest.mark.parametrize(
    ("fields", "sentence"),
    [
        ({"mass": 0.0}, "body.mass: "),
        ({"mass": -1.0}, "body.mass: "),
        ({"mass": 1.0, "density": 2.0}, "density: must be left out where mass is given"),
        ({"shape": "plane"}, "body.shape: "),
        ({"size": (0.0, 1.0, 1.0)}, "body.size"),
        ({"mesh": grid(2, 2)}, r"body.0.thickness: is missing, and \w+ is not closed"),
        ({"position": (0, 0.2, 0)}, "body.0.position: it starts 0.3 m deep inside the ground"),
        ({"position": (5.0, 1.0, 0)}, "body.0.position: it starts .* m deep inside obstacle 0"),
        ({"position": (0.2, 3.0, 0)}, r"balloon.0.position: \w+ starts .* m deep inside body 0"),
        ({"position": (-5.0, 2.0, 0)}, "sphere.0.position: it starts .* m deep inside body 0"),
    ],
)
def test_nonsense_gets_one_sentence(fields, sentence):
    inside = Balloon(mesh=quad_sphere(4, 0.5), position=(0, 3.0, 0))
    table = Obstacle(size=(1, 1, 1), position=(5, 1, 0))
    ball = Sphere(position=(-5, 2, 0), radius=0.3)

    def begin() -> Simulator:
        body = Body(**{"position": (0, 7.0, 0)} | fields)
        scene = Scene(balloon=[inside], body=[body], obstacle=[table], sphere=[ball], ground=Ground())
        return Simulator(scene, "cpu")

    with pytest.raises(InputError, match=sentence) as refused:
        begin()
    assert "\n" not in str(refused.value)


def test_what_is_far_away_or_beside_a_body_may_start(device):
    """A sphere far from a body, or beside it, is no overlap, however large or near."""
    spheres = [Sphere(position=(20, 2, 0), radius=5.0), Sphere(position=(0, 2.8, 0), radius=0.29)]
    started(device, Body(position=(0, 2, 0)), sphere=spheres, ground=Ground(height=1.5))


@pytest.mark.parametrize("world_count", [1, 8])
def test_auto_takes_launches(world_count, device):
    """Launches move all worlds with bodies, of any size, since no frame is free; on a CPU with the forces of octets."""
    model = Simulator(scene_of(Body()), device, world_count).model
    schedule = schedule_named("auto", model)
    assert issubclass(schedule, GatherSchedule)
    assert schedule.name == ("octets" if device == "cpu" else "gather")


def test_worlds_differ_by_what_is_varied(device):
    scene = scene_of(Body(position=(0, 1, 0)), gravity=0.0)
    vary = {"body.0.velocity.1": [1.0, -2.0], "body.0.mass": [1.0, 3.0]}
    simulator = Simulator(scene, device, world_count=2, vary=vary)
    after(simulator, 100)
    np.testing.assert_allclose(simulator.state.body_positions.numpy()[:, 0, 1], [2.0, -1.0], rtol=1000 * 0.5 * EPSILON)
