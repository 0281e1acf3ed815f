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
        help="The side that one looks from: 0 is the front, 90 the right, 180 the back. 32 if not given.",
        rich_help_panel=CAMERA,
    ),
]
Elevation = Annotated[
    float | None,
    typer.Option(
        metavar="DEGREES",
        help="The height that one looks from: 0 is level, 90 is straight from above. 13 if not given.",
        rich_help_panel=CAMERA,
    ),
]
Zoom = Annotated[
    float | None,
    typer.Option(
        metavar="FACTOR", help="How many times as large everything is: 2 is twice as near.", rich_help_panel=CAMERA
    ),
]
LookAt = Annotated[
    str | None,
    typer.Option(
        "--look-at",
        metavar="NAME|X,Y,Z",
        help="What is in the middle: something in the stage, such as String_0, or a point. If not given, "
        "all that moves.",
        rich_help_panel=CAMERA,
    ),
]
Follow = Annotated[
    bool,
    typer.Option(
        "--follow",
        metavar="",
        help="Move the camera along with the balloons, or with what --look-at names.",
        rich_help_panel=CAMERA,
    ),
]


Aperture = Annotated[
    float,
    typer.Option(
        metavar="WIDTH",
        help="How wide the lens is, in the stage's unit. A wider lens blurs more of what is nearer or "
        "farther than --focus.",
        rich_help_panel=CAMERA,
    ),
]
Focus = Annotated[
    str | None,
    typer.Option(
        metavar="NAME|X,Y,Z", help="What is sharp. If not given, what is in the middle.", rich_help_panel=CAMERA
    ),
]
Shutter = Annotated[
    float,
    typer.Option(
        metavar="FRAMES",
        help="How long the shutter is open, 0 to 1 frame. A longer time blurs more of what moves.",
        rich_help_panel=CAMERA,
    ),
]
Transparent = Annotated[
    bool,
    typer.Option(
        "--transparent",
        metavar="",
        help="Leave out backdrop, ground and water, but keep the shadow, for a .png or .webp to lay over "
        "something else.",
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
