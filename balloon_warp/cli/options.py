"""What several commands take, said once."""

from typing import Annotated

import typer

from balloon_warp.mesh.units import METERS

SCENE, OUTPUT, MACHINE, LONG = "The scene", "What is written", "How it runs", "If it takes long or goes wrong"
"""the parts of a command's help"""

SceneName = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="The name of a bundled scene, which `balloon-warp scenes` lists; a scene file, .toml; or a mesh: OBJ, "
        "USD, STL, PLY, OFF, glTF or GLB.",
    ),
]
Set = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Change a value of the scene: balloon.mass=0.2, sphere.0.radius=0.3, gravity=0. May be given again.",
        rich_help_panel=SCENE,
    ),
]
Weld = Annotated[
    bool,
    typer.Option(
        "--weld",
        metavar="",
        help="Join faces wherever vertices lie at exactly the same place, not along open seams alone.",
        rich_help_panel=SCENE,
    ),
]
UnitOption = Annotated[
    str | None,
    typer.Option(
        "--unit",
        metavar="|".join(METERS),
        help="Of the mesh's coordinates: it gets its true size, and a mesh by itself true gravity.",
        rich_help_panel=SCENE,
    ),
]
FramesPerSecond = Annotated[
    float | None,
    typer.Option("--fps", metavar="RATE", help="Frames a second, such as 24.", rich_help_panel=SCENE),
]
Frames = Annotated[
    int | None, typer.Option("--frames", metavar="COUNT", help="How many frames.", rich_help_panel=SCENE)
]
Seconds = Annotated[
    float | None,
    typer.Option("--seconds", metavar="TIME", help="How many seconds, instead of --frames.", rich_help_panel=SCENE),
]
Device = Annotated[
    str | None,
    typer.Option(metavar="NAME", help="cpu, cuda:0 and so on; the GPU if there is one.", rich_help_panel=MACHINE),
]
Schedule = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="How the work is laid out, for speed: auto, scatter, gather, block, lanes or octets.",
        rich_help_panel=MACHINE,
    ),
]
Json = Annotated[
    bool,
    typer.Option("--json", metavar="", help="Print JSON on standard output, for programs.", rich_help_panel=OUTPUT),
]
Resume = Annotated[
    bool,
    typer.Option(
        "--resume",
        metavar="",
        help="Go on from where the same command, stopped or killed, was saved.",
        rich_help_panel=LONG,
    ),
]
Size = Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="Of a picture, in pixels.", rich_help_panel=OUTPUT)]
