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
    """[Pa]; 101325.0 when missing"""
    temperature: float = field_of("air_temperature")
    """of the air, and of gas at its pressure [K]; 293.15 when missing"""
    density: float | None = optional_field_of("air_density")
    """that of dry air as an ideal gas when missing [kg/m^3]"""
    lapse: float | None = optional_field_of("air_lapse")
    """how much colder the air gets with height; pressure and density, given at height 0, fall with it: 0.0065 in the
    standard atmosphere, 0 where the temperature stays; if missing, the air is the same at all heights [K/m]"""
    wind: Vector = field_of("wind")
    """velocity of the air [m/s]; [0.0, 0.0, 0.0] when missing"""
    shear: float = field_of("wind_shear")
    """the exponent with which the wind grows with height, from none at height 0, up to ten times `wind_height`: 0.14
    over open land, 0.3 in towns; with 0 it is the same at all heights [1]; 0.0 when missing"""
    wind_height: float = field_of("wind_height")
    """the height at which `wind` holds, if the wind grows with height [m]; 10.0 when missing"""
    roughness: float = field_of("wind_roughness")
    """the roughness length of the ground, from which the wind grows with the logarithm of the height, up to ten times
    `wind_height`: 0.0002 over the open sea, 0.03 over grass, 0.25 over high crops, 1 in suburbs; 0 is none; `shear` is
    another way to say how it grows [m]; 0.0 when missing"""
    gusts: float = field_of("gusts")
    """how strong gusts are: the root mean square of each component of their velocity, over the wind's; 0.1 on a calm
    day, 0.3 in streets [1]; 0.0 when missing"""
    gust_length: float = field_of("gust_length")
    """how large gusts are, the integral scale of turbulence [m]; 10.0 when missing"""
    gust_seed: int = field_of("gust_seed")
    """another seed draws other gusts [1]; 0 when missing"""


class Ground(Table):
    """A plane across the up axis."""

    height: float = field_of("ground_height")
    """[m]; 0.0 when missing"""
    friction: float = field_of("ground_friction")
    """Coulomb's coefficient [1]; 0.5 when missing"""
    restitution: float = field_of("ground_restitution")
    """rebound speed over impact speed, for spheres [1]; 0.3 when missing"""


class Water(Table):
    """A liquid below a level surface: it presses on the outside of balloons, and brakes what moves in it.

    Inside a balloon it is dry, an open one too: a bowl floats with its rim up. Spheres do not feel it.
    """

    level: float = field_of("water_level")
    """height of its surface [m]; 0.0 when missing"""
    density: float = field_of("water_density")
    """[kg/m^3]; 1000.0 when missing"""
    drag: float = field_of("water_drag")
    """c of the drag 1/2 density c A |v| v, A the wetted area that moves at v [1]; 1.0 when missing"""
