"""A scene as a whole, and that its parts fit together."""

import itertools
import math
from typing import Annotated, Any, Literal, Self

from pydantic import Field, model_validator

from balloon_warp.scene.schema.balloon import Balloon
from balloon_warp.scene.schema.bodies import Sphere, String
from balloon_warp.scene.schema.fields import (
    MOST_MISSED,
    Index,
    LawTables,
    NonNegative,
    Positive,
    Table,
    Vector,
    field_of,
    missed_between_frames,
)
from balloon_warp.scene.schema.obstacles import Obstacle
from balloon_warp.scene.schema.rigid import Body
from balloon_warp.scene.schema.surroundings import Atmosphere, Box, Ground, Picture, Water
from balloon_warp.scene.schema.touch import Touch

MESHED = ("balloon", "obstacle", "body")
"""lists of the scene whose tables may have a mesh"""
WITHOUT_MESHES = {name: {"__all__": {"mesh"}} for name in MESHED}
"""what to leave out of a scene that is to be plain values: a mesh that came from Python is none"""


class Tube(Table):
    """A tube between two balloons with gas: through it flows the gas that the difference of pressures drives."""

    balloons: tuple[Index, Index]
    """which two, by their places in the scene"""
    conductance: NonNegative
    """flow for each pascal between them [mol/(s Pa)]"""


class Change(Table):
    """Values of the scene that change, all at once, while it is simulated."""

    time: NonNegative
    """when [s]; it happens at the first frame that is not before"""
    set: Annotated[dict[str, Any], Field(min_length=1)]
    """the new values by their paths, as in overrides: { "balloon.helium" = 12.0 }. What may change is what may differ
    between worlds, but for places and velocities at the start; and `substeps`, `solver`, `normals`, `correction` and
    `contact`."""


class Scene(Table):
    """One world: balloons, and what is around them."""

    description: str = ""
    """one line, shown by `balloon-warp scenes`"""
    up_axis: Literal["Y", "Z"] = "Y"
    """which axis points up"""
    gravity: float = field_of("gravity")
    """the acceleration against the up axis [m/s^2]; 9.81 when missing"""
    frames: Annotated[int, Field(ge=1)] = 120
    """how many frames follow the start"""
    frames_per_second: Positive = 60.0
    """[1/s]"""
    substeps: Annotated[int, Field(ge=1, le=100_000)] | Literal["auto"] = "auto"
    """integration steps in a frame; "auto" takes as many as stability asks, and bodies and spheres"""
    solver: Literal["symplectic_euler", "forward_euler", "projective"] = "symplectic_euler"
    """how a step goes on: v += h a, then x += h v (the paper's listing); or x += h v, then v += h a; or, stable at any
    step, backward Euler by local and global steps (Liu et al. 2013)"""
    solver_iterations: Annotated[int, Field(ge=1, le=10_000)] | Literal["auto"] = "auto"
    """how many iterations "projective" makes in each substep; "auto" makes 10 to 200, until they change little"""
    correction: Literal["none", "provot", "tarantino"] = "none"
    """after a step, "provot" shortens springs that are longer than (1 + correction_limit) times their rest length to
    that (Provot 1995); with "tarantino" they do not pull there either, as in the paper"""
    correction_limit: float = field_of("correction_limit")
    """strain beyond which a spring is shortened [1]; 0.1 when missing"""
    correction_sweeps: Annotated[int, Field(ge=1, le=1000)] = 4
    """how often a correction goes through all springs"""
    normals: Literal["cached", "fresh"] = "fresh"
    """normals and areas of the paper's inflation, "normal_force": refreshed once a frame, as there, or every substep"""
    contact: Literal["penalty", "impulse"] = "penalty"
    """what a sphere gets from a touching particle: a force in proportion to the balloon's inflation (the paper); or the
    momentum that the particle loses, so that balloons and spheres together keep theirs and gain no energy"""
    net_forces: bool = False
    """write the net force on each particle into the stage, as curves"""
    picture_frame: Index | None = None
    """the frame that a picture of this scene shows; the last when missing or past the end"""
    picture: Picture | None = None
    """From where a picture of the scene is taken, unless an option says otherwise."""
    balloon: Annotated[list[Balloon], Field(min_length=1)]
    """A mesh that becomes a balloon."""
    sphere: list[Sphere] = []
    """A rigid sphere that collides with balloons, spheres, obstacles and the ground."""
    string: list[String] = []
    """A string from a fixed anchor to one particle: it pulls when taut and does not push."""
    obstacle: list[Obstacle] = []
    """A rigid thing that balloons and spheres cannot enter: it stays, or moves as it is told, whatever pushes it."""
    body: list[Body] = []
    """A free rigid body, with mass and inertia: balloons press on it and carry it."""
    ground: Ground | None = None
    """A plane across the up axis."""
    water: Water | None = None
    """A liquid below a level surface: it presses on the outside of balloons, and brakes what moves in it."""
    tube: list[Tube] = []
    """A tube between two balloons with gas: through it flows the gas that the difference of pressures drives."""
    touch: Touch | None = None
    """What happens where surfaces of balloons meet. Without this table they pass through each other."""
    box: Box | None = None
    """A box in which the table of a batch counts balloons, as `in_box`: those whose centers are inside."""
    atmosphere: Atmosphere = Atmosphere()
    """The air around the balloons, alike everywhere unless it has a `lapse`, `shear`, `roughness` or `gusts`."""
    law: LawTables = {}
    """parameters of laws of one's own that are the world's, by law and name"""
    change: list[Change] = []
    """what changes while it is simulated, in order of time"""

    @property
    def up(self) -> Vector:
        """Direction of the up axis, a unit vector."""
        return (0.0, 1.0, 0.0) if self.up_axis == "Y" else (0.0, 0.0, 1.0)

    @property
    def touches(self) -> bool:
        """Whether any surfaces can touch."""
        return self.touches_itself or (self.touch is not None and self.touch.balloons and len(self.balloon) > 1)

    @property
    def touches_spheres(self) -> bool:
        """Whether spheres that are small beside faces touch these."""
        return self.touch is not None and self.touch.spheres and bool(self.sphere)

    @property
    def touches_itself(self) -> bool:
        """Whether parts of a balloon can touch each other."""
        return self.touch is not None and self.touch.itself

    @model_validator(mode="after")
    def _fits_together(self) -> Self:
        for number, string in enumerate(self.string):
            if string.balloon >= len(self.balloon):
                raise ValueError(
                    f"string.{number}.balloon: must be below the number of balloons, {len(self.balloon)} "
                    f"(got {string.balloon})"
                )
        if self.correction != "none" and not any(
            not balloon.material.is_membrane or balloon.material.springs for balloon in self.balloon
        ):
            raise ValueError(
                f'correction: "{self.correction}" shortens springs, and no balloon has any; expected "none", or a '
                'material with `springs`, or kind = "springs"'
            )
        times = [change.time for change in self.change]
        if any(later < earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"change: times must not decrease (got {times})")
        for number, balloon in enumerate(self.balloon):
            inflation = balloon.inflation
            times = [time for time, _ in inflation.keyframes] if inflation.has_keyframes else []
            shortest = min((later - earlier for earlier, later in itertools.pairwise(times)), default=math.inf)
            too_close = shortest * self.frames_per_second < 1.0 - 1e-6
            if too_close and missed_between_frames(inflation.keyframes, 1.0 / self.frames_per_second) > MOST_MISSED:
                raise ValueError(
                    f"balloon.{number}.inflation.{inflation.keyframed}: keyframes must be at least a frame apart, "
                    f"{1.0 / self.frames_per_second:g} s, or change little within one (got {shortest:g} s)"
                )
            if inflation.kind == "gas" and balloon.helium:
                raise ValueError(f"balloon.{number}.helium: must be 0, its gas lifts it (got {balloon.helium:g})")
        for number, tube in enumerate(self.tube):
            self._check_tube(number, tube)
        return self

    def _check_tube(self, number: int, tube: Tube) -> None:
        first, second = tube.balloons
        if first == second or max(tube.balloons) >= len(self.balloon):
            raise ValueError(
                f"tube.{number}.balloons: must be two balloons below the number of balloons, {len(self.balloon)} "
                f"(got {first} and {second})"
            )
        ends = self.balloon[first].inflation, self.balloon[second].inflation
        if any(end.kind != "gas" for end in ends):
            raise ValueError(f'tube.{number}.balloons: both must have inflation.kind = "gas"')
        if ends[0].gamma != ends[1].gamma or ends[0].molar_mass != ends[1].molar_mass:
            raise ValueError(f"tube.{number}.balloons: both must have the same gamma and molar_mass")
