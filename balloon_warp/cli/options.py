"""Options that several commands share."""

from dataclasses import dataclass
from typing import Annotated, Any, get_args

import typer

from balloon_warp.mesh.parts import Taken
from balloon_warp.mesh.units import METERS

SCENE, OUTPUT, MACHINE, LONG = "Scene", "Output", "Execution", "Long runs and failures"
"""Headings of the sections of a command's help"""

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
        help="Change a value of the scene: balloon.mass=0.2, sphere.0.radius=0.3, gravity=0. May be repeated.",
        rich_help_panel=SCENE,
    ),
]
PartsOption = Annotated[
    str | None,
    typer.Option(
        "--parts",
        metavar="|".join(get_args(Taken)),
        help="Parts of the mesh that make up the balloon: all, the closed ones, without loose ribbons such "
        "as hair, or the largest.",
        rich_help_panel=SCENE,
    ),
]
PrimOption = Annotated[
    str | None,
    typer.Option(
        "--prim",
        metavar="NAME",
        help="Object of the mesh file: by its name, or in a USD stage by its path, such as /Room/Wall0, "
        "or that of what it stands in.",
        rich_help_panel=SCENE,
    ),
]
UpOption = Annotated[
    str | None,
    typer.Option(
        "--up",
        metavar="Y|Z",
        help="Up axis of the mesh file. CAD, scans and many STL files have Z.",
        rich_help_panel=SCENE,
    ),
]


def _device_to(work: str) -> Any:
    return typer.Option(
        metavar="NAME",
        help=f"Device to {work} on: cpu, cuda:0 and so on. If not given, the GPU if there is one.",
        rich_help_panel=MACHINE,
    )


Device = Annotated[str | None, _device_to("simulate")]
RenderDevice = Annotated[str | None, _device_to("render")]
Schedule = Annotated[
    str,
    typer.Option(
        metavar="NAME",
        help="Parallel schedule, which affects speed only: auto, scatter, gather, block, lanes or octets.",
        rich_help_panel=MACHINE,
    ),
]
Json = Annotated[
    bool,
    typer.Option(
        "--json", metavar="", help="Print JSON to standard output, for other programs.", rich_help_panel=OUTPUT
    ),
]
Force = Annotated[
    bool,
    typer.Option(
        "--force",
        metavar="",
        help="Also replace files that Balloon Warp did not write, or that were edited since.",
        rich_help_panel=OUTPUT,
    ),
]
Resume = Annotated[
    bool,
    typer.Option(
        "--resume",
        metavar="",
        help="Resume from the last checkpoint of the same command.",
        rich_help_panel=LONG,
    ),
]
Size = Annotated[
    str, typer.Option(metavar="WIDTHxHEIGHT", help="Size of each picture in pixels.", rich_help_panel=OUTPUT)
]


@dataclass(frozen=True)
class MeshOptions:
    """Options of commands that read a mesh file."""

    weld: Annotated[
        str | None,
        typer.Option(
            "--weld",
            metavar="[GAP]",
            help="Weld open seams whose gap is at most this fraction of the mesh's size, such as 1e-4. "
            "Without a number, weld wherever vertices coincide exactly.",
            rich_help_panel=SCENE,
        ),
    ] = None
    parts: PartsOption = None
    unit: Annotated[
        str | None,
        typer.Option(
            "--unit",
            metavar="|".join(METERS),
            help="Unit of the mesh's coordinates. The mesh then has its true size and, without "
            "a scene file, true gravity.",
            rich_help_panel=SCENE,
        ),
    ] = None
    prim: PrimOption = None
    up: UpOption = None
    inflate: Annotated[
        float | None,
        typer.Option(
            "--inflate",
            metavar="STRETCH",
            help="Stretch of the skin of each balloon without other inflation: 0.2 makes a sphere's radius a fifth "
            "larger, a volume of 1.73. 0.08 by default for a mesh by itself, a volume of 1.26, to which other shapes "
            "swell, too.",
            rich_help_panel=SCENE,
        ),
    ] = None


@dataclass(frozen=True)
class LengthOptions:
    """Options of commands that set the simulated time."""

    fps: Annotated[
        float | None,
        typer.Option(
            "--fps", metavar="RATE", help="Frame rate in frames per second, such as 24.", rich_help_panel=SCENE
        ),
    ] = None
    frames: Annotated[
        int | None,
        typer.Option("--frames", metavar="COUNT", help="Number of frames to simulate.", rich_help_panel=SCENE),
    ] = None
    seconds: Annotated[
        float | None,
        typer.Option(
            "--seconds",
            metavar="TIME",
            help="Duration in seconds, instead of --frames.",
            rich_help_panel=SCENE,
        ),
    ] = None
