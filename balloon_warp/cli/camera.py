"""Options of commands that make pictures: where one looks from, and through what."""

from collections.abc import Mapping
from typing import Annotated, Any, TypedDict

import typer

from balloon_warp.cli.size import parse_place

CAMERA = "Where one looks"
"""a part of the help"""

Azimuth = Annotated[
    float | None,
    typer.Option(
        metavar="DEGREES",
        help="From there: 0 is the front, 90 the right, 180 the back; 32 if not given.",
        rich_help_panel=CAMERA,
    ),
]
Elevation = Annotated[
    float | None,
    typer.Option(metavar="DEGREES", help="From so far above: 90 is the top; 13 if not given.", rich_help_panel=CAMERA),
]
Zoom = Annotated[
    float | None,
    typer.Option(
        metavar="FACTOR", help="Show everything so many times as large: 2 is twice as near.", rich_help_panel=CAMERA
    ),
]
LookAt = Annotated[
    str | None,
    typer.Option(
        "--look-at",
        metavar="NAME|X,Y,Z",
        help="What is in the middle: a thing of the stage, such as String_0, or a point; all that moves if not given.",
        rich_help_panel=CAMERA,
    ),
]
Follow = Annotated[
    bool,
    typer.Option(
        "--follow",
        metavar="",
        help="Go along with the balloons, or with what --look-at names.",
        rich_help_panel=CAMERA,
    ),
]


Aperture = Annotated[
    float,
    typer.Option(
        metavar="WIDTH",
        help="How wide the lens is, in the stage's unit: what is nearer or farther than --focus is blurred.",
        rich_help_panel=CAMERA,
    ),
]
Focus = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|X,Y,Z", help="What is sharp; what is in the middle if not given.", rich_help_panel=CAMERA
    ),
]
Shutter = Annotated[
    float,
    typer.Option(
        metavar="FRAMES", help="How long it is open, 0 to 1 frame: what moves is blurred.", rich_help_panel=CAMERA
    ),
]
Transparent = Annotated[
    bool,
    typer.Option(
        "--transparent",
        metavar="",
        help="Leave out backdrop, ground and water, and keep the shadow: a .png or .webp to lay over something else.",
        rich_help_panel=CAMERA,
    ),
]


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


def asked_of(given: Mapping[str, Any]) -> Asked:
    """What the command line's words ask of the camera; of all parameters of a command, those that are the camera's.

    Raises:
        InputError: a place has another form.
    """
    asked = {name: given[name] for name in Asked.__annotations__}
    for name in ("look_at", "focus"):
        asked[name] = parse_place(asked[name], name.replace("_", "-")) if asked[name] else None
    return Asked(**asked)
