"""Contacts of a scene, which are empty where nothing meets: inputs of `contact` and `touch`, from the host's plan."""

from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np

from balloon_warp.mesh.placement import rotation_matrix
from balloon_warp.mesh.triangles import triangles_of
from balloon_warp.model.bodies import initial_centers, settle_bodies
from balloon_warp.model.body_samples import sample
from balloon_warp.model.folded import is_folded
from balloon_warp.model.friction import FRICTION
from balloon_warp.model.meeting_edges import edges_meet, meeting_edges
from balloon_warp.model.ridges import NO_RIDGES, Ridges, kept_distance
from balloon_warp.model.touch import APART, STIFFNESSES, THICKNESS, crowd_of, edge_length
from balloon_warp.model.tunneling import held_within, widest_opening
from balloon_warp.reference.balls import SmallSpheres
from balloon_warp.reference.meeting import Edges
from balloon_warp.reference.meeting import Ridges as MeetingRidges
from balloon_warp.reference.touch import Touch
from balloon_warp.schedules.touch_table import ITSELF

CENTER = Ridges(np.zeros((1, 2, 3)), np.zeros((1, 2, 3)), 0.0, np.ones(1, np.int32))
"""Ridge of a sphere, which has its radius"""


class Contacts:
    """Contacts of a scene: `touch`, `edges`, `ridges` and `small`, each None where nothing meets so."""

    def __init__(self, plan, owner):
        scene, self.shapes, self.owner = plan.scene, plan.shapes, owner
        firsts = np.searchsorted(owner, np.arange(len(self.shapes)))
        triangles = [triangles_of(shape.mesh) + first for shape, first in zip(self.shapes, firsts, strict=True)]
        self.touch: Any = self._touch(scene, triangles) if scene.touches else None
        self.edges: Any = None
        if edges_meet(scene, self.shapes):
            edges = [own + first for own, first in zip(meeting_edges(scene, self.shapes), firsts, strict=True)]
            self.edges = self._edges(edges, triangles)
        sizes = [widest_opening(shape.mesh) for shape in self.shapes]
        most = held_within(scene) * max(sizes) if scene.touches_spheres else 0.0
        is_small, faces = [ball.radius < most for ball in scene.sphere], np.concatenate(triangles)
        self.small = SmallSpheres(np.flatnonzero(is_small), owner, faces) if any(is_small) else None
        self.first, solids = len(plan.obstacles), len(plan.obstacles) + len(plan.bodies)
        meets = scene.touches_spheres and scene.contact == "impulse" and (plan.ridges or scene.faces is True)
        balls = [CENTER if meets and not small else NO_RIDGES for small in is_small]
        of_solids = plan.ridges or [NO_RIDGES] * solids
        ridges = [*of_solids[: self.first], *balls, *of_solids[self.first :]]
        kept = kept_distance(self.shapes) * np.insert(np.ones(solids + 1), [self.first] * len(balls), 0.0)
        some = any(len(each.ends) for each in ridges)
        self.ridges = MeetingRidges(ridges, kept, owner, faces) if some else None

    def settle(self, parameters):
        """Take parameters, which change over time."""
        friction, count = parameters[FRICTION][0], len(self.shapes)
        of_solids = friction[-count:, 1:-count]
        if self.touch:
            share = np.concatenate([shape.mass_share for shape in self.shapes])
            mass = (share * parameters["mass"][0, self.owner])[:, None]
            self.touch.ease = np.where(mass > 0.0, 1.0 / np.where(mass > 0.0, mass, 1.0), 0.0)
            self.touch.skins = self._skins(parameters, friction[-count:, -count:])
        if self.edges:
            self.edges.skins = self.touch.skins
        if self.small:
            self.small.friction = of_solids[:, self.first :]
        if self.ridges:
            self.ridges.friction = of_solids

    def _touch(self, scene, triangles):
        far, sizes = None, np.array([edge_length(shape.mesh) for shape in self.shapes])
        if scene.touches_itself:
            rest = np.concatenate([shape.mesh.points for shape in self.shapes])
            apart = sizes * [ITSELF if is_folded(shape.mesh) else APART for shape in self.shapes]
            far = np.linalg.norm(rest[:, None] - rest, axis=-1) >= apart[self.owner][:, None]
        crowds = [crowd_of(self.shapes, number, scene.touches_itself) for number in range(len(self.shapes))]
        closed = np.array([shape.closed for shape in self.shapes])
        return Touch(triangles, self.owner, far, np.array(crowds)[self.owner], 0.5 * sizes, closed)

    def _edges(self, edges, triangles):
        """Return all pairs of edges, and of particles and triangles, of balloons, or far from each other in one."""
        balloons = range(len(edges))
        own = [np.flatnonzero(self.owner == number)[:, None] for number in balloons]
        of_edges = [_pairs(edges[i], edges[j]) for i in balloons for j in balloons[i:]]
        of_points = [_pairs(own[i], triangles[j]) for i, j in product(balloons, repeat=2)]
        pairs = self._far(np.concatenate(of_edges), 2), self._far(np.concatenate(of_points), 1)
        return Edges(*pairs, self.owner)

    def _far(self, pairs, count):
        """Return pairs of features, of which the first has so many particles, that may touch."""
        may = self.owner[pairs[:, 0]] != self.owner[pairs[:, -1]]
        if self.touch.far is not None:
            may |= self.touch.far[pairs[:, :count, None], pairs[:, None, count:]].all(axis=(1, 2))
        return pairs[may]

    def _skins(self, parameters, friction):
        """Return thickness, stiffness and friction between balloons."""
        skins = np.zeros((*friction.shape, 3))
        own = [float(np.float32(THICKNESS * edge_length(shape.mesh))) for shape in self.shapes]
        thickness, stiffness = (float(np.ravel(parameters[f"touch_{name}"])[0]) for name in ("thickness", "stiffness"))
        for i, j in product(range(len(own)), repeat=2):
            a, b = parameters[STIFFNESSES][0, [i, j]]
            mean = 0.5 * (own[i] + own[j]) if thickness < 0.0 else thickness
            skins[i, j] = mean, 2.0 * a * b / (a + b) if stiffness < 0.0 else stiffness, friction[i, j]
        return skins


def solid_of(shape, up):
    """Return the input of `solids.surface` for an obstacle's or a body's shape."""
    return SimpleNamespace(shape=shape.kind, size=shape.size, thickness=shape.thickness, up=up)


def things_of(plan):
    """Return the ground and obstacles, which nothing moves."""
    up, none = np.array(plan.scene.up), np.zeros(3)
    still = {"mass": np.inf, "turning": np.zeros((3, 3)), "radius": 0.0, "reach": 0.0}
    still |= {"velocity": none, "spin": none, "turn": np.eye(3)}
    ground = SimpleNamespace(shape="plane", size=none, thickness=0.0, up=up)
    obstacles = [
        {"solid": solid_of(shape, up), "samples": sample(shape, up), "reach": min(shape.reach, 1e30)}
        for shape in plan.obstacles
    ]
    return [still | thing for thing in [{"solid": ground}, *obstacles]]


def bodies_of(plan, parameters):
    """Return the free bodies at the start."""
    found, up = [], np.array(plan.scene.up)
    masses = settle_bodies(plan.scene, plan.bodies, parameters)["body_mass"][0]
    centers = initial_centers(plan.scene, plan.bodies, parameters["initial_body_positions"])[0]
    for number, (body, shape) in enumerate(zip(plan.scene.body, plan.bodies, strict=True)):
        turn, ease = rotation_matrix(body.rotation), np.linalg.inv(shape.inertia)
        mass = float(masses[number])
        velocity, spin = (parameters[f"initial_body_{name}"][0, number] for name in ("velocities", "spins"))
        found.append(
            {"position": centers[number], "start": centers[number], "velocity": velocity, "spin": spin, "turn": turn,
             "mass": mass, "radius": 0.0, "ease": ease, "turning": turn @ ease @ turn.T / mass,
             "samples": shape.samples, "solid": solid_of(shape.solid, up), "reach": shape.solid.reach}
        )  # fmt: skip
    return found


def _pairs(one, other):
    """Return all pairs of rows, one after the other."""
    i, j = np.divmod(np.arange(len(one) * len(other)), max(len(other), 1))
    return np.concatenate([one[i], other[j]], axis=1)
