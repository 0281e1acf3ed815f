"""What several commands take, said once."""

from dataclasses import dataclass
from typing import Annotated, get_args

import typer

from balloon_warp.mesh.parts import Taken
from balloon_warp.mesh.units import METERS

SCENE, OUTPUT, MACHINE, LONG = "The scene", "What is written", "How it runs", "If it takes long or goes wrong"
"""the parts of a command's help"""

SceneName = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="A bundled scene (`balloon-warp scenes` lists them), a scene file (.toml), or a mesh: OBJ, "
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
PartsOption = Annotated[
    str | None,
    typer.Option(
        "--parts",
        metavar="|".join(get_args(Taken)),
        help="Which parts of the mesh the balloon is made of: all, those that are closed, without loose ribbons such "
        "as hair, or the largest.",
        rich_help_panel=SCENE,
    ),
]
PrimOption = Annotated[
    str | None,
    typer.Option(
        "--prim",
        metavar="PATH",
        help="Of a USD stage, the mesh to take, such as /Room/Wall0, or what has meshes below it.",
        rich_help_panel=SCENE,
    ),
]
Device = Annotated[
    str | None,
    typer.Option(
        metavar="NAME",
        help="What to simulate on: cpu, cuda:0 and so on. If not given, the GPU if there is one.",
        rich_help_panel=MACHINE,
    ),
]
Schedule = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="How the work is divided, which only changes the speed: auto, scatter, gather, block, lanes or octets.",
        rich_help_panel=MACHINE,
    ),
]
Json = Annotated[
    bool,
    typer.Option(
        "--json", metavar="", help="Print JSON to standard output, for other programs.", rich_help_panel=OUTPUT
    ),
]
Resume = Annotated[
    bool,
    typer.Option(
        "--resume",
        metavar="",
        help="Go on where the same command was last saved before it was stopped or killed.",
        rich_help_panel=LONG,
    ),
]
Size = Annotated[
    str, typer.Option(metavar="WIDTHxHEIGHT", help="How large each picture is, in pixels.", rich_help_panel=OUTPUT)
]


@dataclass(frozen=True)
class MeshOptions:
    """Options of commands that say how a mesh file is read."""

    weld: Annotated[
        str | None,
        typer.Option(
            "--weld",
            metavar="[GAP]",
            help="Join faces along open seams that are so far apart, as a part of the mesh's size, such as 1e-4. "
            "Without a number, wherever vertices are at exactly the same place.",
            rich_help_panel=SCENE,
        ),
    ] = None
    parts: PartsOption = None
    unit: Annotated[
        str | None,
        typer.Option(
            "--unit",
            metavar="|".join(METERS),
            help="The unit of the mesh's numbers. The mesh then has its true size and, if it is run without "
            "a scene file, true gravity.",
            rich_help_panel=SCENE,
        ),
    ] = None
    prim: PrimOption = None
    up: Annotated[
        str | None,
        typer.Option(
            "--up",
            metavar="Y|Z",
            help="The axis of the mesh's file that points up. CAD, scans and many STL files have Z.",
            rich_help_panel=SCENE,
        ),
    ] = None
    inflate: Annotated[
        float | None,
        typer.Option(
            "--inflate",
            metavar="STRETCH",
            help="How much the skin of a balloon is stretched, of which nothing else says how it is inflated: 0.1 "
            "makes a ball's radius a tenth larger, and is what a mesh by itself gets.",
            rich_help_panel=SCENE,
        ),
    ] = None


@dataclass(frozen=True)
class LengthOptions:
    """Options of commands that say how long the simulated time is."""

    fps: Annotated[
        float | None,
        typer.Option("--fps", metavar="RATE", help="How many frames a second has, such as 24.", rich_help_panel=SCENE),
    ] = None
    frames: Annotated[
        int | None,
        typer.Option("--frames", metavar="COUNT", help="How many frames to simulate.", rich_help_panel=SCENE),
    ] = None
    seconds: Annotated[
        float | None,
        typer.Option(
            "--seconds",
            metavar="TIME",
            help="How many seconds to simulate, instead of --frames.",
            rich_help_panel=SCENE,
        ),
    ] = None
