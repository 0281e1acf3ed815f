"""The command `balloon-warp design`."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from balloon_warp.cli.options import LONG, OUTPUT, Device, Resume
from balloon_warp.cli.progress import stages, warn, watched
from balloon_warp.errors import InputError, StoppedError
from balloon_warp.warp_logging import quiet_warp

if TYPE_CHECKING:
    from balloon_warp.designing.job import Design

DESIGN = "Design"
"""Heading of a section of the help"""

Stretch = Annotated[
    float | None,
    typer.Option(
        metavar="RATIO",
        help="Stretch of the skin in the target shape. If not given, 1.2 for springs and 2 for latex.",
        rich_help_panel=DESIGN,
    ),
]


@dataclass(frozen=True)
class Wanted:
    """Options of the design."""

    of: Annotated[
        str,
        typer.Option(
            metavar="springs|latex|foil",
            help="Kind of design: springs, with a rest length for each; latex, with the shape of its mould; or foil, "
            "with its outline: TARGET is then letters, or a drawing, .svg; or, with --panels, a mesh.",
            rich_help_panel=DESIGN,
        ),
    ] = "springs"
    stretch: Stretch = None
    hold: Annotated[
        str,
        typer.Option(
            metavar="tension|any",
            help="Forces that springs may bear: tension alone, or also compression.",
            rich_help_panel=DESIGN,
        ),
    ] = "tension"
    size: Annotated[
        float | None,
        typer.Option(
            metavar="METERS",
            help="Largest dimension of the target shape. If not given, that of its file, and 0.3 for letters and "
            "drawings.",
            rich_help_panel=DESIGN,
        ),
    ] = None
    thickness: Annotated[
        str,
        typer.Option(
            metavar="METERS|LOW:HIGH",
            help="Thickness of the latex or foil. For latex a range lets it vary by place, where the mould alone does "
            "not reach the shape.",
            rich_help_panel=DESIGN,
        ),
    ] = "2e-4"
    panels: Annotated[
        str | None,
        typer.Option(
            metavar="COUNT|SEAMS",
            help="Panels of foil for TARGET, a mesh: the number of gores around its vertical axis; a file of seams, "
            "as lines of vertices; or `materials` or `groups`, whose borders become seams.",
            rich_help_panel=DESIGN,
        ),
    ] = None
    gravity: Annotated[
        float,
        typer.Option(
            metavar="M/S2",
            help="Gravity under which latex takes the shape, 9.81 on Earth: it hangs from --fixed, Y up.",
            rich_help_panel=DESIGN,
        ),
    ] = 0.0
    fixed: Annotated[
        str | None,
        typer.Option(
            metavar="VERTEX|GROUP,...",
            help="Pinned vertices of TARGET, counted from 0, and groups, from which it hangs. If not given, its group "
            "`neck`.",
            rich_help_panel=DESIGN,
        ),
    ] = None


View = Annotated[
    bool,
    typer.Option(
        "--view", metavar="", help="Show the design in the browser while it converges, with the error as color."
    ),
]
Port = Annotated[
    int | None,
    typer.Option(min=0, max=65535, metavar="NUMBER", help="Port of --view. If not given, 8080 or the next free one."),
]


def design(
    target: Annotated[str, typer.Argument(metavar="TARGET", help="Target shape: a closed mesh.")],
    output: Annotated[
        Path,
        typer.Option("--output", "-o", metavar="DIR", help="Output folder.", rich_help_panel=OUTPUT),
    ],
    steps: Annotated[
        int, typer.Option(metavar="COUNT", help="Number of steps of the optimization.", rich_help_panel=LONG)
    ] = 30,
    resume: Resume = False,
    device: Device = None,
    view: View = False,
    port: Port = None,
    *,
    wanted: Wanted,
) -> None:
    """Design the balloon that inflates to a target shape, and simulate it from rest.

    DIR gets balloon.toml, which runs as it is, springs.npz, mould.stl or pattern.svg, error.png and report.json. Try
    `balloon-warp design toy.obj -o toy`, then `balloon-warp run toy/balloon.toml`.
    """
    from balloon_warp.designing.design import design as designed  # loads SciPy and Warp

    quiet_warp()
    if view and wanted.of == "foil" and wanted.panels is None:
        raise InputError("--view: needs --of springs, --of latex or panels of foil (got --of foil without --panels)")
    asked = {**vars(wanted), "thickness": _thickness(wanted.thickness), "fixed": _fixed(wanted.fixed)}
    last = ["before the first step"]
    with watched(view, port, Path(target).name) as watch, stages(Path(target).name) as stage:

        def on_stage(words: str) -> None:
            last[0] = f"at {words}"
            stage(words)

        try:
            found = designed(
                target, **asked, folder=output, steps=steps, resume=resume, device=device, on_stage=on_stage,
                on_step=watch,
            )  # fmt: skip
        except KeyboardInterrupt:
            raise StoppedError(f"design was interrupted {last[0]}; --resume continues from the last step") from None
        stage.end()
        _say(found, output)


def _say(found: "Design", output: Path) -> None:
    for sentence in found.cannot:
        warn(sentence)
    print(f"simulated from rest: error {found.error} of the size; as designed {found.held_error}", end="")
    print(f"; plain shape at the same stretch {found.plain_error}" if found.plain_error else "")
    print(f"wrote {output}, {found.got}: balloon-warp run {output / 'balloon.toml'} inflates it")


def _thickness(said: str) -> float | tuple[float, float]:
    """Parse a thickness, or a range of them."""
    try:
        low, *high = (float(part) for part in said.split(":"))
    except ValueError:
        low, high = 0.0, [0.0] * 2
    if len(high) > 1:
        raise InputError(f"--thickness: expected a number, or a range such as 2e-4:6e-4 (got {said})")
    return (low, high[0]) if high else low


def _fixed(said: str | None) -> list[int | str] | None:
    """Parse vertices and groups."""
    return None if said is None else [int(part) if part.isdecimal() else part for part in said.split(",") if part]
