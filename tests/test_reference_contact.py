"""Contact in the reference: where features are nearest, conservation by every kind, and results of single contacts."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from meshes import quad_sphere
from rigid import SPACE, body_state, scene_of

from balloon_warp import Balloon, Body, Ground, Inflation, Obstacle, Scene, Simulator, Sphere
from balloon_warp.lab.reference import Reference
from balloon_warp.lab.reference.contact import (
    Movers,
    Touch,
    edge_contacts,
    edge_edge,
    momenta,
    point_contacts,
    point_triangle,
    resolve,
    ridge_contacts,
    spheres_meet,
    sweep,
)
from balloon_warp.model.touch import Ridges as Lines

PLACES = np.random.default_rng(1).normal(size=(400, 4, 3))
SKIN = np.full((2, 2, 3), [1.0, 200.0, 0.4])
"""Thickness, stiffness and friction between two balloons"""
OWNER = np.array([0, 0, 0, 0, 1, 1, 1, 1])
FACES = np.array([[4, 5, 6], [4, 6, 7]])
SHAPE = [(-1.0, 0.1, 0.2), (0.9, -0.2, 0.3), (0.2, 0.4, 0.25), (0.1, 0.6, 0.4),
         (0.1, -1.0, 0.0), (0.8, 0.1, 0.1), (-0.1, 0.9, 0.05), (-0.9, 0.2, -0.1)]  # fmt: skip
"""Four particles of a balloon above four of another"""


def require_nearest(x: np.ndarray, weights: np.ndarray, first: int) -> None:
    """Check the condition of the nearest places y of two convex features: (y of the other - y) . (corner - y) <= 0.

    Args: first: number of points of the first feature."""
    way = (weights * x).sum(axis=1, keepdims=True)
    for part in (slice(0, first), slice(first, 4)):
        own, sign = np.abs(weights[:, part]), np.sign(weights[:, part].sum(axis=1))
        np.testing.assert_allclose(own.sum(axis=1), 1.0, rtol=1e-12)
        place = (own * x[:, part]).sum(axis=1, keepdims=True)
        assert (sign * (way * (x[:, part] - place)).sum(axis=-1)).min() > -1e-11  # rounding
    assert len(np.unique(np.sign(np.round(weights[..., 0], 12)), axis=0)) > 3  # corners, sides and insides


@pytest.mark.parametrize(("nearest", "first"), [(point_triangle, 1), (edge_edge, 2)])
def test_the_nearest_places_of_a_point_and_a_triangle_or_two_edges(nearest: Callable, first: int):
    require_nearest(PLACES, nearest(PLACES), first)


RIDGE = Lines(np.array([[(-0.9, 0.5, 0.25), (0.9, 0.5, 0.3)]]), np.zeros((1, 2, 3)), 0.01, np.array([3], np.int32))
"""Ridge of a box below faces, which is near them"""


def with_box(x: np.ndarray, v: np.ndarray, ease: np.ndarray) -> Movers:
    """Return particles and the box after them."""
    m = Movers(np.vstack([x, (0.1, -0.5, -0.6)]), np.vstack([v, (0.0, 0.0, 4.0)]), np.vstack([ease, 1.0 / 0.7]))
    m.spin[-1], m.turning[-1], m.radius[-1] = (0.1, 0.2, 0.3), np.diag([3.0, 5.0, 7.0]), 0.02
    return m


def edges_of(m: Movers) -> np.ndarray:
    return edge_contacts(np.array([[0, 1, 4, 6], [0, 1, 5, 7], [2, 3, 5, 6]]), m.x, OWNER, SKIN)


def points_of(m: Movers) -> np.ndarray:
    return point_contacts(np.array([[own, *face] for own in range(4) for face in FACES]), m.x, OWNER, SKIN)


def ridges_of(m: Movers) -> np.ndarray:
    m.friction, row = np.full((1, 1), 0.3), (m, 8, RIDGE.radius, (0.5, 0.01), m.x[:8])
    edges = np.unique(np.sort(FACES[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1), axis=0)
    found = np.concatenate(ridge_contacts(row, RIDGE, FACES, edges))
    return found[np.isfinite(found["gap"][:, 0])]


def touch_of(m: Movers) -> np.ndarray:
    own, closed = np.arange(4), np.array([True, True])
    touch = Touch([FACES[:0], FACES], OWNER, None, np.ones(8), np.ones(2), closed, SKIN)
    return touch._beside(m.x, np.insert(FACES[touch._nearest(m.x, own, FACES, False)], 0, own, axis=1))[0]


KINDS: dict[str, Callable[[Movers], np.ndarray]] = {
    "edges": edges_of, "points": points_of, "ridges": ridges_of, "touch": touch_of,
}  # fmt: skip


def movers(seed: int) -> Movers:
    rng = np.random.default_rng(seed)
    x, v = np.array(SHAPE) + 0.02 * rng.normal(size=(8, 3)), rng.normal(size=(8, 3))
    v[:, 2] += np.repeat([-2.0, 2.0], 4)  # they approach
    return with_box(x, v, 1.0 / rng.uniform(0.1, 2.0, (8, 1)))


def energy(m: Movers) -> float:
    turned = sum(spin @ np.linalg.solve(own, spin) for spin, own in zip(m.spin[8:], m.turning[8:], strict=True))
    return 0.5 * float((m.v**2 / m.ease).sum() + turned)


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", KINDS)
def test_a_contact_keeps_momentum_and_angular_momentum(kind: str, seed: int):
    m = movers(seed)
    c = KINDS[kind](m)
    assert len(c)
    rubs = sum(resolve(m, c, np.ones((len(c), 1))))
    assert kind == "points" or (c["friction"] > 0.0).any()
    linear, angular = momenta(c, rubs)
    np.testing.assert_allclose(linear.sum(axis=1), 0.0, atol=1e-13 * np.abs(linear).max())
    whole = (np.cross(m.x[c["ends"]], linear) + angular).sum(axis=1)
    np.testing.assert_allclose(whole, 0.0, atol=1e-12 * np.abs(linear).max())


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("kind", KINDS)
def test_contacts_that_stop_what_approaches_all_at_once_give_no_energy(kind: str, seed: int):
    m, h = movers(seed), 1e-3
    c = KINDS[kind](m)
    c["gap"], c["kept"] = 1.0, 1.0
    before = energy(m)
    sweep(m, c, h, 200)
    assert energy(m) < before
    assert (m.velocity(c) * c["normal"]).sum(axis=1).min() >= -(c["left"] / h).max() - 1e-3


def two_balls(x: Any, v: Any) -> Movers:
    """Return solid spheres of 2 kg and 0.5 m that have moved for 0.1 s."""
    m = Movers(np.array(x), np.array(v), np.full((2, 1), 0.5))
    m.h, m.start = 0.1, m.x - 0.1 * m.v
    m.turning[:], m.radius[:], m.restitution[:] = 2.5 / (2.0 * 0.5**2) * np.eye(3), 0.5, 1.0
    return m


def test_elastic_spheres_exchange_their_velocities_on_the_way():
    """Spheres start 1.2 m apart at 4 m/s, touch after 0.05 s of 0.1 s, and part for as long."""
    m = two_balls([(-0.3, 0.0, 0.0), (0.5, 0.0, 0.0)], [(3.0, 0.0, 0.0), (-1.0, 0.0, 0.0)])
    spheres_meet(m, [0, 1], lambda m, number: None)
    np.testing.assert_allclose(m.v[:, 0], [-1.0, 3.0], rtol=1e-12)
    np.testing.assert_allclose(m.x[:, 0], [-0.5, 0.7], rtol=1e-12)


@pytest.mark.parametrize(("friction", "gain"), [(10.0, 1.4 / 7.0), (0.1, 0.1)])
def test_spheres_that_grip_each_other_roll_off_and_others_obey_coulomb(friction: float, gain: float):
    """Sliding at s = 1.4 m/s is stopped by the impulse s m / 7, as 1 + M R^2 / I = 7/2 of each, or slowed down by
    friction times the push, of 1 m/s; each gets the same spin."""
    m = two_balls([(-0.45, 0.0, 0.0), (0.45, 0.0, 0.0)], [(1.0, 0.7, 0.0), (-1.0, -0.7, 0.0)])
    m.start = np.array([(-0.55, 0.0, 0.0), (0.55, 0.0, 0.0)])
    m.friction, m.gravity = np.full((1, 1), friction), 50.0  # below two steps of which nothing rebounds
    spheres_meet(m, [0, 1], lambda m, number: None)
    np.testing.assert_allclose(m.v[0], [0.0, 0.7 - gain, 0.0], atol=1e-12)
    np.testing.assert_allclose(m.spin[0], m.spin[1], atol=1e-12)
    np.testing.assert_allclose(m.spin[0, 2], 2.5 / 0.5 * -gain, rtol=1e-12)


def on_a_slope(friction: float, degrees: float) -> np.ndarray:
    """Return how far a brick comes in half a second on a slope."""
    turn, out = (0.0, 0.0, degrees), np.array([-np.sin(np.radians(degrees)), np.cos(np.radians(degrees)), 0.0])
    brick = Body(size=(0.4, 0.2, 0.4), position=tuple(0.1 * out), rotation=turn, friction=friction)
    slope = Obstacle(shape="plane", rotation=turn, friction=friction)
    reference = Reference(scene_of(brick, obstacle=[slope], frames_per_second=20.0, substeps=20, gravity=10.0))
    start = reference.bodies[0]["position"]
    for _ in range(10):
        reference.frame()
    return reference.bodies[0]["position"] - start


def test_a_sphere_that_has_yet_to_begin_waits_above_the_ground():
    waits = Sphere(position=(0.0, 2.0, 0.0), radius=0.2, velocity=(2.0, 0.0, 0.0), start=1.0)
    balloon = Balloon(mesh=quad_sphere(2))
    reference = Reference(Scene(balloon=[balloon], sphere=[waits], ground=Ground(height=-1.0), contact="impulse"))
    reference.frame()
    assert reference.spheres[0]["position"] == pytest.approx((0.0, 2.0, 0.0))


@pytest.mark.full
def test_a_brick_stays_on_a_slope_below_the_angle_of_friction():
    """A creep is allowed that sweeps leave: 3e-5 of a step of gravity, in 200 steps of 2.5 ms."""
    assert np.linalg.norm(on_a_slope(0.5, 25.0)) < 3e-5 * 10.0 * 2.5e-3 * 0.5 * 10.0


@pytest.mark.full
def test_a_brick_slides_down_a_slope_by_the_rest_of_gravity():
    """Acceleration is g (sin - friction cos), the way that of symplectic Euler, h longer."""
    angle, seconds, h = np.radians(40.0), 0.5, 2.5e-3
    way = 0.5 * 10.0 * (np.sin(angle) - 0.3 * np.cos(angle)) * seconds * (seconds + h)
    assert np.linalg.norm(on_a_slope(0.3, 40.0)) == pytest.approx(way, rel=1e-3)


def test_bodies_that_rub_and_rebound_move_as_the_product_moves_them(device: str):
    """Two boxes of restitution 1, whose rebound with friction would give energy: to 1e-5."""
    common: dict[str, Any] = {"size": (0.2, 0.3, 0.15), "restitution": 1.0, "friction": 0.5}
    of = scene_of(
        Body(position=(-0.4, 0.05, 0.0), rotation=(20.0, 30.0, 10.0), velocity=(3.0, 0.0, 0.0), mass=1.0,
             angular_velocity=(5.0, -4.0, 3.0), **common),
        Body(position=(0.4, 0.0, 0.0), rotation=(50.0, 10.0, 70.0), velocity=(-1.0, 0.0, 0.0), mass=3.0, **common),
        frames_per_second=24.0, substeps=8, frames=8, **SPACE,
    )  # fmt: skip
    simulator, reference = Simulator(of, device, schedule="gather"), Reference(of)
    for _ in range(of.frames):
        simulator.step_unread()
        reference.frame()
    for name, atol in (("positions", 1e-5), ("velocities", 1e-4)):
        expected = [body[name.replace("ies", "y").rstrip("s")] for body in reference.bodies]
        np.testing.assert_allclose(body_state(simulator, name), expected, atol=atol)


@pytest.mark.full
def test_bodies_move_as_the_product_moves_them(device: str):
    """A box that a balloon and a sphere hit from above, on the ground; a body's place by 2e-6 m in 40 steps."""
    of = Scene(
        balloon=[Balloon(mesh=quad_sphere(3, 0.5), position=(0.0, 1.0, 0.0), velocity=(0.0, -2.0, 0.0), mass=0.05,
                         inflation=Inflation(pressure=50.0),
                         stiffness={"structural": 100.0, "shear": 50.0, "flexion": 20.0})],
        body=[Body(size=(0.8, 0.4, 0.4), mass=0.5, position=(0.1, 0.2, 0.05), rotation=(0.0, 20.0, 0.0),
                   velocity=(0.3, 0.0, 0.1), angular_velocity=(0.0, 2.0, 0.0))],
        sphere=[Sphere(radius=0.1, mass=0.1, position=(0.4, 0.7, 0.05), velocity=(0.0, -4.0, 0.0), friction=0.4)],
        frames=4, frames_per_second=100.0, substeps=10, faces=True, ground=Ground(),
    )  # fmt: skip
    simulator, reference = Simulator(of, device, schedule="gather"), Reference(of)
    for _ in range(of.frames):
        simulator.step_unread()
        reference.frame()
    body, sphere = reference.bodies[0], reference.spheres[0]
    assert 0.0 < body["spin"][1] < 2.0
    np.testing.assert_allclose(body_state(simulator, "positions")[0], body["position"], atol=2e-6)
    np.testing.assert_allclose(simulator.state.points.numpy()[0], reference.x, atol=1e-5)
    np.testing.assert_allclose(simulator.state.sphere_positions.numpy()[0, 0], sphere["position"], atol=2e-6)
