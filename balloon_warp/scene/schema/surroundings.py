"""What is around the balloons: air, water and ground."""

from balloon_warp.scene.schema.fields import Table, Vector, field_of, optional_field_of


class Atmosphere(Table):
    """The air around the balloons, alike everywhere."""

    pressure: float = field_of("air_pressure")
    temperature: float = field_of("air_temperature")
    density: float | None = optional_field_of("air_density")
    wind: Vector = field_of("wind")


class Ground(Table):
    """A plane across the up axis."""

    height: float = field_of("ground_height")
    friction: float = field_of("ground_friction")
    restitution: float = field_of("ground_restitution")


class Water(Table):
    """A liquid below a level surface: it presses on the outside of balloons, and brakes what moves in it.

    Inside a balloon it is dry, an open one too: a bowl floats with its rim up. Spheres do not feel it.
    """

    level: float = field_of("water_level")
    density: float = field_of("water_density")
    drag: float = field_of("water_drag")
