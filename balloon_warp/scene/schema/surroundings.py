"""Surroundings of the balloons: air, water and ground, the box in which a batch counts them, and the camera."""

from typing import Annotated, Any, Self

from pydantic import Field, ModelWrapValidatorHandler, model_validator

from balloon_warp.scene.schema.fields import Color, Table, Vector, field_of, optional_field_of
from balloon_warp.scene.standard_air import HIGHEST, LOWEST, standard_air


class Box(Table):
    """Box in which the table of a batch counts balloons, as `in_box`: those whose centers are inside."""

    lower: Vector
    """Corner of the least coordinates [m]"""
    upper: Vector
    """Corner of the greatest coordinates [m]"""

    @model_validator(mode="after")
    def _has_an_inside(self) -> Self:
        if any(low >= high for low, high in zip(self.lower, self.upper, strict=True)):
            raise ValueError(f"upper: must be above lower in every coordinate (got {self.upper}, lower {self.lower})")
        return self


class Picture(Table):
    """Camera and light of the scene's picture. Options for the camera have precedence."""

    azimuth: Annotated[float, Field(ge=-360, le=360)] | None = None
    """Azimuth of the camera from the front, +Z, or -Y where Z is up, toward +X [degrees]; 32 when missing"""
    elevation: Annotated[float, Field(ge=0, le=90)] | None = None
    """Elevation of the camera above the horizon [degrees]; 13 when missing"""
    zoom: Annotated[float, Field(ge=0.01, le=100)] = 1.0
    """Zoom factor; with 1 the whole animation just fits in"""
    look_at: Vector | None = None
    """Point in the middle of the picture [m]; when missing, the middle of the whole animation"""
    paper: Color | None = None
    """Color of the paper that is the ground and the backdrop; a warm white when missing"""
    light: Annotated[float, Field(ge=-180, le=180)] | None = None
    """Azimuth of the main light, from the camera toward its right: with 90 it shines from the right, with 180 from
    behind the scene [degrees]; -45 when missing"""


class Atmosphere(Table):
    """Air around the balloons, uniform unless it has a `lapse` or `altitude`, `shear`, `roughness` or `gusts`."""

    altitude: Annotated[float, Field(ge=LOWEST, le=HIGHEST)] | None = None
    """Altitude of the scene's height 0 above sea: `pressure`, `temperature` and `lapse` that are not given are those of
    the U.S. Standard Atmosphere 1976 there [m]"""
    pressure: float = field_of("air_pressure")
    """Air pressure [Pa]; 101325.0 when missing"""
    temperature: float = field_of("air_temperature")
    """Temperature of the air, and of gas at its pressure [K]; 293.15 when missing"""
    density: float | None = optional_field_of("air_density")
    """Density of the air; when missing, that of dry air as an ideal gas [kg/m^3]"""
    lapse: float | None = optional_field_of("air_lapse")
    """Lapse rate, the decrease of temperature with height: 0.0065 in the standard atmosphere up to 11 km, 0 isothermal,
    below 0 where it is warmer above. Pressure and density, given at height 0, fall with height. Uniform air when
    missing [K/m]"""
    wind: Vector = field_of("wind")
    """Wind velocity [m/s]; [0.0, 0.0, 0.0] when missing"""
    shear: float = field_of("wind_shear")
    """Exponent of the wind's power law, from no wind at height 0 up to ten times `wind_height`: 0.14 over open land,
    0.3 in towns, 0 uniform [1]; 0.0 when missing"""
    wind_height: float = field_of("wind_height")
    """Height at which `wind` is given, where it grows with height [m]; 10.0 when missing"""
    roughness: float = field_of("wind_roughness")
    """Roughness length of the ground in the wind's logarithmic law, up to ten times `wind_height`: 0.0002 over the open
    sea, 0.03 over grass, 0.25 over high crops, 1 in suburbs; 0 is none; or else `shear` [m]; 0.0 when missing"""
    gusts: float = field_of("gusts")
    """Turbulence intensity: root mean square of each component of the gusts' velocity over the wind speed; 0.1 on a
    calm day, 0.3 in streets [1]; 0.0 when missing"""
    gust_length: float = field_of("gust_length")
    """Integral length scale of the turbulence [m]; 10.0 when missing"""
    gust_seed: int = field_of("gust_seed")
    """Seed of the random gusts [1]; 0 when missing"""

    @property
    def following(self) -> frozenset[str]:
        """Fields that follow from an altitude, since they were not given."""
        return frozenset(standard_air(0.0)) - self.model_fields_set

    @model_validator(mode="wrap")
    @classmethod
    def _of_the_altitude(cls, given: Any, checked: ModelWrapValidatorHandler[Self]) -> Self:
        air = checked(given)
        if not isinstance(given, dict) or air.altitude is None:
            return air
        following = {name: value for name, value in standard_air(air.altitude).items() if name not in given}
        air = checked(given | following)
        air.model_fields_set.difference_update(following)
        return air


class Ground(Table):
    """Ground plane across the up axis."""

    height: float = field_of("ground_height")
    """Height of the ground [m]; 0.0 when missing"""
    friction: float = field_of("ground_friction")
    """Coulomb friction coefficient [1]; 0.5 when missing"""
    restitution: float = field_of("ground_restitution")
    """Coefficient of restitution for spheres [1]; 0.3 when missing"""


class Water(Table):
    """Liquid below a level surface: it presses on the outside of balloons, and brakes what moves in it.

    Inside a balloon it is dry, an open one too: a bowl floats with its rim up. Spheres do not feel it.
    """

    level: float = field_of("water_level")
    """Height of the surface [m]; 0.0 when missing"""
    density: float = field_of("water_density")
    """Density [kg/m^3]; 1000.0 when missing"""
    drag: float = field_of("water_drag")
    """Drag coefficient c of 1/2 density c A |v| v, where A is the wetted area moving at v [1]; 1.0 when missing"""
