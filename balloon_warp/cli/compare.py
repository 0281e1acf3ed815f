"""The command `balloon-warp compare`."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from balloon_warp.cli.names import own_name
from balloon_warp.cli.options import (
    OUTPUT,
    Changes,
    Device,
    LengthOptions,
    SceneName,
    Schedule,
    Set,
    Size,
    parse_size,
)
from balloon_warp.cli.progress import Console, begun, frame_progress
from balloon_warp.comparison.choices import parse_choices, shown
from balloon_warp.errors import InputError
from balloon_warp.scene.load import scene_name
from balloon_warp.warp_logging import quiet_warp

if TYPE_CHECKING:
    from balloon_warp.comparison.compare import Comparison

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
    from balloon_warp.comparison.compare import compare as run_all  # loads Warp and USD: only for a good scene

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
