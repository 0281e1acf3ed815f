"""Options of the camera, for commands that make pictures."""

from dataclasses import dataclass
from typing import Annotated, TypedDict, cast

import typer

from balloon_warp.cli.size import parse_place

CAMERA = "Camera"
"""Heading of a section of the help"""


class Asked(TypedDict):
    """Options of `render_stage`."""

    azimuth: float | None
    elevation: float | None
    zoom: float | None
    look_at: str | tuple[float, float, float] | None
    follow: bool
    aperture: float
    focus: str | tuple[float, float, float] | None
    shutter: float
    transparent: bool


@dataclass(frozen=True)
class CameraOptions:
    """Options of commands with a camera."""

    azimuth: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES",
            help="Azimuth of the camera: 0 is the front, 90 the right, 180 the back. 32 if not given.",
            rich_help_panel=CAMERA,
        ),
    ] = None
    elevation: Annotated[
        float | None,
        typer.Option(
            metavar="DEGREES",
            help="Elevation of the camera: 0 is level, 90 is straight from above. 13 if not given.",
            rich_help_panel=CAMERA,
        ),
    ] = None
    zoom: Annotated[
        float | None,
        typer.Option(
            metavar="FACTOR", help="Magnification: 2 doubles the size in the picture.", rich_help_panel=CAMERA
        ),
    ] = None
    look_at: Annotated[
        str | None,
        typer.Option(
            "--look-at",
            metavar="NAME|X,Y,Z",
            help="Center of the picture: a prim of the stage, such as String_0, or a point. If not given, "
            "all that moves.",
            rich_help_panel=CAMERA,
        ),
    ] = None
    follow: Annotated[
        bool,
        typer.Option(
            "--follow",
            metavar="",
            help="Track the balloons with the camera, or the target of --look-at.",
            rich_help_panel=CAMERA,
        ),
    ] = False
    aperture: Annotated[
        float,
        typer.Option(
            metavar="WIDTH",
            help="Diameter of the lens, in the stage's unit. A wider lens has less depth of field around --focus.",
            rich_help_panel=CAMERA,
        ),
    ] = 0.0
    focus: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|X,Y,Z",
            help="Prim or point in focus. If not given, the center of the picture.",
            rich_help_panel=CAMERA,
        ),
    ] = None
    shutter: Annotated[
        float,
        typer.Option(
            metavar="FRAMES",
            help="Shutter time, 0 to 1 frame, for motion blur.",
            rich_help_panel=CAMERA,
        ),
    ] = 0.0
    transparent: Annotated[
        bool,
        typer.Option(
            "--transparent",
            metavar="",
            help="Omit backdrop, ground and water, but keep the shadow, for a .png or .webp to composite.",
            rich_help_panel=CAMERA,
        ),
    ] = False

    def asked(self) -> Asked:
        """Return the options as arguments of `render_stage`.

        Raises:
            InputError: a place has another form.
        """
        places = {
            name: parse_place(place, name.replace("_", "-")) if place else None
            for name, place in (("look_at", self.look_at), ("focus", self.focus))
        }
        return cast("Asked", vars(self) | places)
