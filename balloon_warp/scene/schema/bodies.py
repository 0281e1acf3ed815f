"""What balloons touch and are tied with, for all the time or some of it: spheres and strings."""

from typing import Any, Literal

from pydantic import model_validator

from balloon_warp.scene.schema.fields import Color, Index, NonNegative, Positive, Table, UnitInterval, Vector


def _ends_after_its_start(lasting: Any) -> Any:
    if lasting.end is not None and lasting.end < lasting.start:
        raise ValueError(f"end: must not come before the start, {lasting.start:g} s (got {lasting.end:g} s)")
    return lasting


class Sphere(Table):
    """A rigid sphere that collides with balloons, spheres, obstacles and the ground."""

    radius: Positive = 0.15
    """[m]"""
    mass: Positive = 1.0
    """[kg]"""
    position: Vector
    """of its center at the start [m]"""
    velocity: Vector = (0.0, 0.0, 0.0)
    """at the start [m/s]"""
    angular_velocity: Vector = (0.0, 0.0, 0.0)
    """at the start [rad/s]; it has no effect without friction"""
    penalty: NonNegative = 1.0
    """force it gets from a touching particle, as a multiple of that particle's inflation force; it has no effect with
    `contact = "impulse"`"""
    restitution: UnitInterval = 0.3
    """rebound speed over impact speed where it meets a sphere; of two different ones, their geometric mean [1]"""
    friction: NonNegative = 0.0
    """Coulomb's coefficient; where two things meet, the geometric mean of both counts, so that with 0 it slides on
    everything and does not turn; with balloons it counts where `contact = "impulse"`, or where the sphere is small and
    touches faces [1]"""
    color: Color | None = None
    """linear RGB; one of the palette when missing"""
    start: NonNegative = 0.0
    """when it appears, at its position and velocity [s]; until then nothing touches it"""
    end: NonNegative | None = None
    """when it is gone [s]; never when missing"""

    _lives = model_validator(mode="after")(_ends_after_its_start)


class String(Table):
    """A string from a fixed anchor to one particle: it pulls when taut and does not push."""

    anchor: Vector
    """its fixed end [m]"""
    balloon: Index = 0
    """the balloon it holds, by its place in the scene"""
    particle: Index | Literal["highest", "lowest"] = "lowest"
    """the particle it holds, by the order of the file's vertices, counted from 0, or along the up axis at the start"""
    length: Positive | None = None
    """[m]; the distance from anchor to particle at the start when missing"""
    stiffness: Positive = 20.0
    """[N/m]"""
    start: NonNegative = 0.0
    """when it is tied [s]"""
    end: NonNegative | None = None
    """when it is cut [s]; never when missing"""
    knot: bool = True
    """whether the balloon has a neck and a knot there, to be seen and not simulated; foil has none"""

    _lives = model_validator(mode="after")(_ends_after_its_start)
