"""Commands on written stages: `check`, `compare`, `convert` and `render`."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table

from balloon_warp.cli.options import (
    OUTPUT,
    CameraOptions,
    Changes,
    Device,
    Json,
    LengthOptions,
    RenderDevice,
    SceneName,
    Schedule,
    Set,
    Size,
    own_name,
    parse_frames,
    parse_size,
)
from balloon_warp.cli.progress import Console, begun, counted, frame_progress, note, warn
from balloon_warp.errors import InputError
from balloon_warp.scene.load import scene_name
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.tools.choices import parse_choices, shown

if TYPE_CHECKING:
    from balloon_warp.tools.check import CheckReport, Crossing
    from balloon_warp.tools.compare import Comparison


MOST_PAIRS = 20
"""Number of pairs listed at most"""


def check(
    stage: Annotated[
        Path, typer.Argument(metavar="STAGE", help="A USD file that `run` wrote, or any other with moving meshes.")
    ],
    *,
    frames: Annotated[
        str | None,
        typer.Option(metavar="FIRST:LAST", help="Range of frames to check, such as 10:90. All if not given."),
    ] = None,
    within: Annotated[
        float | None,
        typer.Option(
            metavar="METERS",
            help="Tolerated penetration of a balloon into a solid. A twentieth of the mean edge if not given.",
        ),
    ] = None,
    device: Device = None,
    as_json: Json = False,
) -> None:
    """Check a stage for interpenetration.

    Reports which balloons, parts of a balloon, obstacles, bodies, spheres and ground penetrate each other, and where.
    The exit status is 1 if any do.

    Try `balloon-warp check press.usdc`.
    """
    part = parse_frames(frames) if frames else None
    quiet_warp()
    from balloon_warp.tools.check import check_stage  # loads USD: only once the arguments are known to be good

    terminal = Console(emoji=False, stderr=True)
    with Progress(console=terminal, disable=not terminal.is_terminal, transient=True) as progress:
        task = progress.add_task(stage.name, total=None)
        report = check_stage(
            stage,
            frames=part,
            within=within,
            device=device,
            on_frame=lambda done, count: progress.update(task, completed=done, total=count),
            on_note=warn,
        )
    if as_json:
        print(json.dumps({**asdict(report), "passed": report.passed}))
    else:
        _print(report)
    if not report.passed:
        raise typer.Exit(1)


def _print(report: "CheckReport") -> None:
    console = Console(emoji=False, highlight=False, soft_wrap=True)
    things = counted(len(report.things), "thing")
    looked = f"{counted(report.frames, 'frame')}, {things}, {report.triangles:,} triangles"
    pairs: dict[tuple[str, str], list[Crossing]] = {}
    for crossing in report.crossings:
        pairs.setdefault((crossing.first, crossing.second), []).append(crossing)
    said = f"{counted(len(pairs), 'pair')} of objects cross" if pairs else "nothing crosses"
    console.print(f"{report.stage}: {said} ({looked})", markup=False)
    deepest = sorted(pairs.values(), key=lambda those: -max(each.depth for each in those))
    for those in deepest[:MOST_PAIRS]:
        worst = max(those, key=lambda each: each.depth)
        frames = _spans([each.frame for each in those])
        console.print(f"  {worst}; crosses at {frames}", markup=False)
    if len(deepest) > MOST_PAIRS:
        console.print(f"  and {len(deepest) - MOST_PAIRS} shallower pairs; --json lists all", markup=False)


def _spans(frames: Sequence[int]) -> str:
    """Return the numbers as ranges, the first few of them."""
    spans: list[list[int]] = []
    for frame in frames:
        if spans and frame == spans[-1][1] + 1:
            spans[-1][1] = frame
        else:
            spans.append([frame, frame])
    words = [str(begin) if begin == end else f"{begin}-{end}" for begin, end in spans[:4]]
    return ", ".join(words) + (f" and {len(spans) - 4} more" if len(spans) > 4 else "")


RUNS = "Runs"
"""Heading of a section of the help"""
COUNTS = ("frame", "particles", "substeps")
"""Columns that a table reports once where they are equal in all runs"""
TABLE_WIDTH = 10_000
"""Width of the table [columns], above that of any table: rich would cut off names and figures"""
HEADERS = {
    "volume": "volume [m³]",
    "area": "area [m²]",
    "pressure": "pressure [Pa]",
    "center_height": "center [m]",
    "largest_stretch": "stretch",
    "kinetic_energy": "energy [J]",
    "seconds_a_frame": "ms/frame",
}
Vary = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATH=VALUE,...",
        help="Values to compare: normals=cached,fresh or balloon.inflation.k_normal=1,2,4. If repeated, "
        "every combination is run.",
        rich_help_panel=RUNS,
    ),
]
Picture = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FILE",
        help="Picture to write, a .png file. SCENE_compare.png if not given.",
        rich_help_panel=OUTPUT,
    ),
]
TableFile = Annotated[
    Path | None, typer.Option(metavar="FILE", help="Also write the table, to this .csv file.", rich_help_panel=OUTPUT)
]
Frame = Annotated[
    int | None,
    typer.Option(
        metavar="NUMBER",
        help="Frame to show and measure. If not given, the scene's picture frame, or the last.",
        rich_help_panel=RUNS,
    ),
]


def compare(
    scene: SceneName,
    vary: Vary = None,
    overrides: Set = None,
    *,
    length: LengthOptions,
    output: Picture = None,
    table: TableFile = None,
    frame: Frame = None,
    size: Size = "480x270",
    device: Device = None,
    schedule: Schedule = "auto",
) -> None:
    """Compare runs of a scene with different values: one picture, one table.

    Try `balloon-warp compare squirrel_inflate --vary balloon.mass=1,2,4`.
    """
    loaded, name = Changes(overrides, length=length).load(scene), scene_name(scene)
    if not vary:
        raise InputError("--vary: is missing; expected a value to vary, as in --vary normals=cached,fresh")
    picture = output or own_name(Path(f"{name}_compare.png"), loaded)
    quiet_warp()
    from balloon_warp.tools.compare import compare as run_all  # loads Warp and USD: only for a good scene

    choices: dict[str, list[Any]] = {}
    for text in vary or []:
        path, values = parse_choices(text, scene)
        if path in choices:
            raise InputError(f"--vary {text}: {path} is already varied; expected all its values in one --vary")
        choices[path] = values
    with frame_progress() as progress:
        task = progress.add_task(escape(name))
        comparison = run_all(
            loaded,
            choices,
            picture,
            table=table,
            frame=frame,
            size=parse_size(size),
            device=device,
            schedule=schedule,
            on_begin=lambda run, runs, beginning: progress.log_line(
                f"{name}, run {run + 1} of {runs}: {begun(beginning)}"
            ),
            on_frame=lambda run, runs, done, count: progress.update(
                task, completed=run * count + done, total=runs * count
            ),
        )
    console = figure_console()
    print_comparison(console, comparison)
    for path in (comparison.picture, comparison.table):
        if path:
            console.print(f"wrote {path}", markup=False)


def figure_console() -> Console:
    """Return a console that leaves line breaks to the terminal."""
    return Console(emoji=False, highlight=False, soft_wrap=True, width=TABLE_WIDTH)


def print_comparison(console: Console, comparison: "Comparison") -> None:
    """Print the table, figures that are alike in all runs in a line above it, and why runs are not done."""
    done = [run.figures for run in comparison.runs if run.figures]
    alike = {name: done[0][name] for name in COUNTS if len({figures[name] for figures in done}) == 1}
    console.print(", ".join(f"{_header(name)} {_cell(name, value)}" for name, value in alike.items()), style="dim")
    varied = list(comparison.runs[0].values)
    table = Table(box=None, pad_edge=False)
    for path in varied:
        table.add_column(escape(_short(path, varied)))
    names = [name for name in comparison.columns[len(varied) : -2] if name not in alike]
    for name in names:
        table.add_column(escape(_header(name)), justify="right")
    for run in comparison.runs:
        cells = [_cell(name, run.figures.get(name)) for name in names] if run.figures else [run.outcome]
        table.add_row(*map(escape, [*map(shown, run.values.values()), *cells]))
    console.print(table)
    for run in comparison.runs:
        if run.sentence:
            console.print(f"[yellow]{run.outcome}:[/] {escape(', '.join(run.label))}: {escape(run.sentence)}")


def _short(path: str, paths: list[str]) -> str:
    """Cut a dotted path to its end that no other of the paths shares, from a name on."""
    steps = path.split(".")
    ends = (".".join(steps[-length:]) for length in range(1, len(steps)) if not steps[-length].isdecimal())
    return next((end for end in ends if sum(f".{other}".endswith(f".{end}") for other in paths) == 1), path)


def _header(name: str) -> str:
    return HEADERS.get(name, name.replace("_", " "))


def _cell(name: str, value: Any) -> str:
    if value is None:
        return "-"
    if name == "seconds_a_frame":
        return f"{1000.0 * value:.3g}"
    return f"{value:,}" if isinstance(value, int) else f"{value:.4g}"


def convert(
    stage: Annotated[
        Path, typer.Argument(metavar="STAGE", help="A USD file that `run` or `batch` wrote, or any other.")
    ],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="File to write. USD: .usdc, .usda, .usd, .usdz. Other kinds: .glb; .abc, which needs "
            "Blender's module; .h5 for arrays; .pvd for ParaView; out.####.ply or out.####.obj for a "
            "file a frame.",
        ),
    ],
) -> None:
    """Convert an animated stage to another format.

    Try `balloon-warp convert squirrel_tether.usdc -o squirrel.glb`.
    """
    from balloon_warp.studio.exports import export_stage

    terminal = Console(emoji=False, stderr=True)
    with Progress(console=terminal, disable=not terminal.is_terminal, transient=True) as progress:
        task = progress.add_task(output.name, total=None)
        export_stage(
            stage,
            output,
            on_note=note,
            on_frame=lambda done, count: progress.update(task, completed=done, total=count),
        )
    Console(emoji=False, highlight=False, soft_wrap=True).print(f"wrote {output}", markup=False)


def render(
    stage: Annotated[
        Path, typer.Argument(metavar="STAGE", help="A USD file that `run` wrote, or any other with meshes in it.")
    ],
    *,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Picture to write: .png, .webp, .gif or .mp4. STAGE.png if not given.",
        ),
    ] = None,
    frame: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER",
            help="Frame that a .png shows. If not given, the stage's picture frame, or the last.",
        ),
    ] = None,
    size: Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="Size of the picture in pixels.")] = "960x540",
    camera: CameraOptions,
    frames: Annotated[
        str | None, typer.Option(metavar="FIRST:LAST", help="Range of frames of an animation, such as 10:90.")
    ] = None,
    fps: Annotated[
        float | None,
        typer.Option(metavar="RATE", help="Frame rate of the animation, which keeps its true speed."),
    ] = None,
    samples: Annotated[int, typer.Option(metavar="COUNT", help="Rays per pixel. More is smoother and slower.")] = 4,
    device: RenderDevice = None,
) -> None:
    """Render a picture or an animation of a stage. No display is needed.

    Try `balloon-warp render squirrel_tether.usdc -o squirrel.mp4 --azimuth 90`.
    """
    asked = camera.asked()
    pixels = parse_size(size)
    part = parse_frames(frames) if frames else None
    quiet_warp()
    from balloon_warp.studio.render import render_stage  # loads USD: only once the arguments are known to be good

    picture = output or own_name(Path(stage.with_suffix(".png").name))
    terminal = Console(emoji=False, stderr=True)
    with Progress(console=terminal, disable=not terminal.is_terminal, transient=True) as progress:
        task = progress.add_task(picture.name, total=None)
        render_stage(
            stage,
            picture,
            frame=frame,
            size=pixels,
            samples=samples,
            device=device,
            frames=part,
            frames_per_second=fps,
            on_frame=lambda done, count: progress.update(task, completed=done, total=count),
            on_note=warn,
            **asked,
        )
    Console(emoji=False, highlight=False, soft_wrap=True).print(f"wrote {picture}", markup=False)
