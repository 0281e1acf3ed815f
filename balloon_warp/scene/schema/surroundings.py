"""What is around the balloons: air, water and ground."""

from balloon_warp.scene.schema.fields import NonNegative, Positive, Real, Table, UnitInterval, Vector


class Atmosphere(Table):
    """The air around the balloons, alike everywhere."""

    pressure: Positive = 101325.0
    """[Pa]"""
    temperature: Positive = 293.15
    """of the air, and of gas at the air's pressure [K]"""
    density: NonNegative | None = None
    """[kg/m^3]; that of dry air as an ideal gas when missing"""
    wind: Vector = (0.0, 0.0, 0.0)
    """its velocity [m/s]"""


class Ground(Table):
    """A plane across the up axis."""

    height: Real = 0.0
    """[m]"""
    friction: NonNegative = 0.5
    """Coulomb's coefficient, for balloons"""
    restitution: UnitInterval = 0.3
    """rebound speed over impact speed, for spheres"""


class Water(Table):
    """A liquid below a level surface: it presses on the outside of balloons, and brakes what moves in it.

    Inside a balloon it is dry, an open one too: a bowl floats with its rim up. Spheres do not feel it.
    """

    level: Real = 0.0
    """height of its surface [m]"""
    density: Positive = 1000.0
    """[kg/m^3]"""
    drag: NonNegative = 1.0
    """coefficient c of the drag 1/2 density c A |v| v, A the wetted area that moves at v"""
