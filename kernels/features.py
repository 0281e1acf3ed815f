"""Features of a scene: kernels are compiled for them, so that a feature that is absent costs nothing."""

from typing import Any, Literal, NamedTuple

from balloon_warp.kernels.compose import (
    any_names,
    laws_added,
    sum_of_laws,
    sum_of_laws_in_lane,
    sum_of_laws_of_few,
    sum_of_resistances,
)
from balloon_warp.kernels.laws import Columns
from balloon_warp.kernels.laws.air import AIR_ALIKE, AIR_THAT_VARIES
from balloon_warp.kernels.laws.law import RESULT, Kind, Law
from balloon_warp.kernels.laws.outer import DAMPING
from balloon_warp.kernels.tables import BODY_PUSH, GAS, SPHERE_PUSH


class Kept(NamedTuple):
    """A value that each item keeps from substep to substep and from frame to frame."""

    name: str
    item: str
    type: Any
    start: Any
    """Value as the simulation begins"""


class Features(NamedTuple):
    """Features of a model, for all its worlds and all its time."""

    laws: tuple[Law, ...]
    """Laws that act"""
    columns: Columns
    active: tuple[str, ...] = ()
    """Names of the phases that act, of those that not all scenes have by their parameters"""
    keeps: tuple[Kept, ...] = ()
    """Values that items keep for the phases that act"""
    changes: tuple[str, ...] = ()
    """Names of the state that those of the phases change, see `tables.NAMED`"""
    membranes: tuple[Law, ...] = ()
    """Membrane laws of balloons that are not made of springs"""
    viscous: bool = False
    """A membrane has viscosity"""
    softens: bool = False
    """A membrane softens after having been stretched (Mullins effect)"""
    bursts: bool = False
    """A membrane may tear"""
    balloons: int = 1
    spheres: int = 0
    springs_vary: bool = False
    """Springs of one kind have different constants"""
    quads: bool = False
    """Whether all faces are quads"""
    revisits: bool = True
    """Whether a face may have a particle at several corners"""
    rings: bool = False
    """Quads go all around every particle"""
    guarded: bool = False
    """A law may be infinite between a particle and itself"""
    inflation_directions: bool = True
    """A balloon is inflated by normal forces"""
    pressures: bool = False
    """A balloon is inflated by a pressure, given or of a gas"""
    gas: bool = False
    """A balloon has gas, or may be crushed: a substep then sums the other forces before it finds the pressures"""
    takes_air_along: bool = False
    """A gas balloon has added mass"""
    crushes: bool = False
    """A given pressure may be below that outside, and then the volume used up: it acts like a gas's"""
    air_varies: bool = False
    """The air varies with place or time"""
    breathes_on: bool = False
    """Breathing of a gas balloon is damped less than by backward Euler"""
    pumps: bool = False
    """Gas is pumped in or let out, at some time in some world"""
    fills: bool = False
    """Gas is filled in by breaths, litres, moles or a pump's curve, or up to a pressure or a diameter"""
    tubes: bool = False
    """Gas flows through tubes between balloons"""
    vents: bool = False
    """Gas flows out through necks or leaks, at some time in some world"""
    jets: bool = False
    """Gas flows out through necks, whose jets drive balloons"""
    driven: bool = False
    """Outer forces drive groups of particles, at some time in some world"""
    fresh_normals: bool = False
    corrected: bool = False
    """Position correction shortens springs that are too long after a step"""
    forward_euler: bool = False
    """Points move by the old velocities, as in forward Euler"""
    impulses: bool = False
    """Particles and spheres exchange momentum, once all have moved"""
    spheres_rub: bool = False
    """A sphere has friction, and so rotates"""
    small_spheres: bool = False
    """A sphere is so small that it also touches faces, not only particles"""
    ground: bool = False
    fixtures: bool = False
    """Whether there are obstacles, which move as the scene says"""
    fixture_meshes: bool = False
    """An obstacle is a mesh"""
    anchors_move: bool = False
    """Obstacles, bodies or keyframes move the anchor of a string"""
    ties: bool = False
    """A free body carries the anchor of a string"""
    fixtures_move: bool = False
    fixtures_steered: bool = False
    """An obstacle moves"""
    bodies: int = 0
    """Number of free rigid bodies"""
    body_meshes: bool = False
    """A free rigid body is a mesh"""
    tells_contacts: bool = False
    """Contact impulses on particles are summed for output"""
    ridges: bool = False
    """Faces, and not only particles, touch ridges of obstacles and bodies"""
    round_ridges: bool = False
    """Faces touch spheres, too, as if these were ridges"""
    touches: bool = False
    """Balloons touch each other"""
    touches_itself: bool = False
    """Parts of a balloon touch each other"""
    edges_meet: bool = False
    """Sharp edges touch edges, between particles"""
    frames: Literal["all", "free", "apart", "clear", "busy"] = "all"
    """Frames that the kernels advance a world in: in a free frame its particles are far from obstacles and each other,
    see `contact.free_frames`; where it is clear, a search has found nothing that may touch until the next"""

    @property
    def kept(self) -> dict[str, Kept]:
        """The values that items keep, by name."""
        return {each.name: each for each in self.keeps}

    @property
    def kept_views(self) -> dict[str, str]:
        """Views of the kept values of all items, and the value that each item has in a view."""
        return {f"{each.name}s": each.name for each in self.keeps}

    def of_kind(self, kind: Kind) -> tuple[Law, ...]:
        """Return the laws of a kind."""
        return tuple(law for law in self.laws if law.kind == kind)

    def has(self, kind: Kind) -> bool:
        """Return whether there is a law of a kind."""
        return any(law.kind == kind for law in self.laws)

    def needs(self, kind: Kind, given: str) -> bool:
        """Return whether a law of a kind has an argument."""
        return any_names(self.of_kind(kind), given)

    def laws_on(self, kind: Kind) -> Any:
        """Return the function that adds up the laws of a kind."""
        return sum_of_laws(kind, RESULT[kind], self.of_kind(kind), self.columns, self.air)

    def laws_added(self, kind: Kind) -> Any:
        """Return the function that adds the laws of a kind to a sum."""
        return laws_added(kind, RESULT[kind], self.of_kind(kind), self.columns, self.air)

    def laws_of_few(self, kind: Kind) -> tuple[Any, tuple[int, ...]]:
        """Return the sum of the laws of a kind, for a row of the numbers that they name, and the columns of these."""
        return sum_of_laws_of_few(kind, RESULT[kind], self.of_kind(kind), self.columns, self.air)

    def laws_in_lane_on(self, kind: Kind) -> Any:
        """Return the sum of the laws of a kind in one of eight lanes."""
        return sum_of_laws_in_lane(kind, RESULT[kind], self.of_kind(kind), self.columns, self.air)

    @property
    def resistance(self) -> Any:
        """The function that adds up the resistances of the laws on a particle."""
        return sum_of_resistances(self.of_kind("particle"), self.columns, self.air)

    @property
    def air(self) -> tuple[Any, Any]:
        """The functions that give velocity and density of the air at a place."""
        return AIR_THAT_VARIES if self.air_varies else AIR_ALIKE

    @property
    def gas_flows(self) -> bool:
        """Return whether a substep ends with more or less gas in a balloon, by how its pressure is then."""
        return self.tubes or self.vents

    @property
    def gas_changes(self) -> bool:
        """Return whether the amount of gas changes from substep to substep."""
        return self.pumps or self.gas_flows or GAS in self.changes

    @property
    def gas_meets_air(self) -> bool:
        """Return whether gas is exchanged with air that varies with height."""
        return self.gas_changes and self.air_varies

    @property
    def reads_neighbor_velocities(self) -> bool:
        """Dependence of a particle's forces on its neighbors' velocities."""
        return self.viscous or self.needs("spring", "opening")

    @property
    def wears(self) -> bool:
        """Return whether the remaining tension of membranes is computed before each substep's forces."""
        return self.softens or self.bursts

    @property
    def measures_areas(self) -> bool:
        """Return whether area vectors are needed."""
        return self.pressures or self.needs("particle", "area_vector")

    @property
    def directions_on_the_way(self) -> bool:
        """Return whether a block finds directions in its loop over particles, in every substep."""
        return self.rings and self.inflation_directions and self.fresh_normals

    @property
    def in_water(self) -> bool:
        """Return whether the wetted parts of faces are needed."""
        return self.needs("particle", "water_load") or self.resists

    @property
    def damped(self) -> bool:
        """Return whether a balloon is damped."""
        return DAMPING in self.laws

    @property
    def resists(self) -> bool:
        """Return whether a law resists the motion of particles, at the speed that a step ends with."""
        return any(law.resistance for law in self.of_kind("particle"))

    @property
    def always_busy(self) -> bool:
        """Return whether no frame is free.

        Particles are then shifted once all have moved, so that the distance that they travel has no known bound.
        """
        return self.corrected or self.impulses or self.bodies > 0 or self.small_spheres

    @property
    def obstacles(self) -> bool:
        """Return whether there are solids that particles may enter."""
        return self.stands or self.spheres > 0

    @property
    def stands(self) -> bool:
        """Return whether particles stand on the ground or on obstacles, neither of which they push."""
        return self.ground or self.may_touch_obstacles

    @property
    def watched(self) -> bool:
        """Return whether a frame is valid only up to a travel limit of its particles, see `contact.free_frames`."""
        return self.frames in ("free", "apart")

    @property
    def clears(self) -> bool:
        """Return whether searches tell which worlds may go on without contact: where balloons touch themselves.

        Nothing else may be left to launches, and nothing be found as a frame begins that lasts for all of it.
        """
        elsewhere = self.always_busy or self.ridges or self.spheres > 0 or self.bursts or self.tells_contacts
        return self.touches_itself and not elsewhere and (self.fresh_normals or not self.inflation_directions)

    @property
    def touches_alone(self) -> bool:
        """Return whether worlds go through launches only if balloons are near each other, not if obstacles are."""
        return self.touches and not self.meets_solids

    @property
    def may_touch_obstacles(self) -> bool:
        """Return whether particles may touch obstacles."""
        return self.fixtures and self.frames != "free"

    @property
    def spheres_meet(self) -> bool:
        """Return whether there are spheres that may meet each other."""
        return self.spheres > 1

    @property
    def meets_solids(self) -> bool:
        """Return whether bodies move, small spheres meet faces, or edges or ridges meet: all left to launches."""
        return self.bodies > 0 or self.small_spheres or self.edges_meet or self.ridges

    @property
    def lists_contacts(self) -> bool:
        """Return whether contacts are items of a list, see `contact.sweeps`."""
        return self.edges_meet or self.ridges or self.bodies > 0

    @property
    def ridges_first(self) -> bool:
        """Return whether faces meet ridges before particles leave obstacles; bodies alone they meet with the rest."""
        return self.ridges and (self.fixtures or not self.bodies)

    @property
    def without_ridges(self) -> "Features":
        """Return the features that contacts see which meet no ridges."""
        return self._replace(ridges=False, round_ridges=False, spheres_rub=False)

    @property
    def in_blocks(self) -> bool:
        """Return whether the scene has features that `lanes` and `octets` leave to the kernels of `block`."""
        return self.touches or self.meets_solids

    @property
    def keeps_starts(self) -> bool:
        """Return whether the substep reads the spheres' places before it."""
        meets_faces = self.small_spheres or self.round_ridges
        return self.spheres_meet or meets_faces or (self.bodies > 0 and self.spheres > 0)

    @property
    def penalties(self) -> bool:
        """Return whether spheres push particles out one by one, by the paper's rule."""
        return self.spheres > 0 and not self.impulses

    @property
    def spheres_take_forces(self) -> bool:
        """Return whether phases push spheres that exchange momentum, where the paper's rule has no forces."""
        return self.impulses and SPHERE_PUSH in self.changes

    @property
    def bodies_take_forces(self) -> bool:
        """Return whether phases push free bodies."""
        return self.bodies > 0 and BODY_PUSH in self.changes

    @property
    def spheres_pushed(self) -> bool:
        """Return whether forces on spheres are summed in a substep."""
        return self.penalties or self.spheres_take_forces
