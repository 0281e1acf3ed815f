"""Spheres and strings, with the times at which they appear and disappear, and outer forces."""

import itertools
from typing import Annotated, Any, Literal, Self

from pydantic import BeforeValidator, Field, model_validator

from balloon_warp.scene.pinned import pins_of
from balloon_warp.scene.schema.fields import Color, Index, LawTables, NonNegative, Positive, Table, UnitInterval, Vector


def _ends_after_its_start(lasting: Any) -> Any:
    if lasting.end is not None and lasting.end < lasting.start:
        raise ValueError(f"end: must not come before the start, {lasting.start:g} s (got {lasting.end:g} s)")
    return lasting


class Sphere(Table):
    """A rigid sphere that collides with balloons, spheres, obstacles and the ground."""

    radius: Positive = 0.15
    """Radius [m]"""
    mass: Positive = 1.0
    """Mass [kg]"""
    position: Vector
    """Position of the center at the start [m]"""
    velocity: Vector = (0.0, 0.0, 0.0)
    """Velocity at the start [m/s]"""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """Angular velocity at the start [rad/s]; it has no effect without friction"""
    penalty: NonNegative = 1.0
    """Contact force on the sphere as a multiple of the touching particle's inflation force; it has no effect with
    `contact = "impulse"`"""
    restitution: UnitInterval = 0.3
    """Coefficient of restitution between spheres; of two different ones, their geometric mean [1]"""
    friction: NonNegative = 0.0
    """Coulomb friction coefficient; a contact takes the geometric mean of both, so that 0 slides on everything and does
    not turn. Against balloons it acts with `contact = "impulse"`, or where the sphere is small and touches faces [1]"""
    color: Color | None = None
    """Linear RGB, or a color of the web, "red" or "#ff8000"; a color of the palette when missing"""
    start: NonNegative = 0.0
    """Time at which the sphere appears, at its position and velocity [s]; until then nothing touches it"""
    end: NonNegative | None = None
    """Time at which the sphere disappears [s]; never when missing"""

    law: LawTables = {}
    """Parameters of phases of the step that are of spheres, by phase and name"""

    _lives = model_validator(mode="after")(_ends_after_its_start)


class String(Table):
    """A string from an anchor to one particle: it pulls when taut and does not push."""

    anchor: Vector
    """Position of the anchored end [m]; with `obstacle` or `body`, in its own axes from its `position`"""
    obstacle: Index | None = None
    """Obstacle that carries the anchor, by its index in the scene: the anchor moves and turns with it. Fixed in the
    scene when missing"""
    body: Index | None = None
    """Free body that carries the anchor, by its index in the scene, and that the string pulls as hard as the balloon:
    a basket"""
    motion: Annotated[list[tuple[NonNegative, Vector]], Field(min_length=1)] | None = None
    """Keyframes [[time, shift], ...]: shifts from `anchor` [m], linear between them, and constant before the first and
    after the last, as of a hand"""
    balloon: Index = 0
    """Balloon that the string holds, by its index in the scene"""
    particle: Index | Literal["highest", "lowest"] = "lowest"
    """Particle that the string holds, by the order of the file's vertices, counted from 0, or by its place along the up
    axis at the start"""
    length: Positive | None = None
    """Length [m]; the distance from anchor to particle at the start when missing"""
    stiffness: Positive = 20.0
    """Spring constant [N/m]"""
    start: NonNegative = 0.0
    """Time at which the string is tied [s]"""
    end: NonNegative | None = None
    """Time at which the string is cut [s]; never when missing"""
    knot: bool = True
    """Draw the balloon's neck and a knot at the string; they are not simulated, and foil has none"""

    _lives = model_validator(mode="after")(_ends_after_its_start)

    @property
    def moves(self) -> bool:
        """Return whether the anchor may move."""
        return any(each is not None for each in (self.obstacle, self.body, self.motion))

    @model_validator(mode="after")
    def _follows_one(self) -> Self:
        followed = [name for name in ("obstacle", "body", "motion") if getattr(self, name) is not None]
        if len(followed) > 1:
            raise ValueError(f"{followed[1]}: an anchor follows an obstacle, a body or keyframes; expected one of them")
        times = [time for time, _ in self.motion or ()]
        if any(later <= earlier for earlier, later in itertools.pairwise(times)):
            raise ValueError(f"motion: keyframe times must increase (got {times})")
        return self


Particles = list[Index | Annotated[str, Field(min_length=1)]]


class Force(Table):
    """Outer force on some of a balloon's particles, such as the push of a hand or of a motor."""

    balloon: Index = 0
    """Balloon that the force acts on, by its index in the scene"""
    particles: Annotated[Annotated[Particles, Field(min_length=1)], BeforeValidator(pins_of)] | None = None
    """Particles that share the force by their masses: vertices of the file, counted from 0, or all of a group of the
    mesh, by its name; all of the balloon when missing. Fixed ones take no share. In Python also a mask"""
    newtons: Vector = (0.0, 0.0, 0.0)
    """Force on them together, along the axes of the scene [N]"""
