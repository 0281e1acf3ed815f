"""What is around the balloons: air, water and ground, the place in which a batch counts them, and who looks at them."""

from typing import Annotated, Self

from pydantic import Field, model_validator

from balloon_warp.scene.schema.fields import Table, Vector, field_of, optional_field_of


class Box(Table):
    """A box in which the table of a batch counts balloons, as `in_box`: those whose centers are inside."""

    lower: Vector
    """its corner of the least coordinates [m]"""
    upper: Vector
    """the opposite one [m]"""

    @model_validator(mode="after")
    def _has_an_inside(self) -> Self:
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"upper: must be above lower in every coordinate (got {self.upper}, lower {self.lower})")
        return self


class Picture(Table):
    """From where a picture of the scene is taken, unless an option says otherwise."""

    azimuth: Annotated[float, Field(ge=-360, le=360)] | None = None
    """from the front, +Z, or -Y where Z is up, toward +X [degrees]; 32 when missing"""
    elevation: Annotated[float, Field(ge=0, le=90)] | None = None
    """from level toward above [degrees]; 13 when missing"""
    zoom: Annotated[float, Field(ge=0.01, le=100)] = 1.0
    """how many times as large everything is; with 1 all that happens just fits in"""
    look_at: Vector | None = None
    """the point in the middle of the picture [m]; if missing, the middle of all that happens"""


class Atmosphere(Table):
    """The air around the balloons, alike everywhere unless it has a `lapse`, `shear`, `roughness` or `gusts`."""

    pressure: float = field_of("air_pressure")
    temperature: float = field_of("air_temperature")
    density: float | None = optional_field_of("air_density")
    lapse: float | None = optional_field_of("air_lapse")
    wind: Vector = field_of("wind")
    shear: float = field_of("wind_shear")
    wind_height: float = field_of("wind_height")
    roughness: float = field_of("wind_roughness")
    gusts: float = field_of("gusts")
    gust_length: float = field_of("gust_length")
    gust_seed: int = field_of("gust_seed")


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
