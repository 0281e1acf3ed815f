"""The commands `balloon-warp design` and `balloon-warp fit`."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from balloon_warp.cli.options import LONG, MACHINE, OUTPUT, SCENE, Device, Json, Resume
from balloon_warp.cli.progress import Stages, note, stages, warn, watched
from balloon_warp.errors import InputError, StoppedError
from balloon_warp.system.files import check_writable, png_mark, whole_file
from balloon_warp.system.warp_setup import quiet_warp

if TYPE_CHECKING:
    from balloon_warp.lab.design.job import Design
    from balloon_warp.lab.fit.curve import CurveFit
    from balloon_warp.lab.fit.fit import Fit


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
class DesignOptions:
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
    wanted: DesignOptions,
) -> None:
    """Design the balloon that inflates to a target shape, and simulate it from rest.

    DIR gets balloon.toml, which runs as it is, springs.npz, mould.stl or pattern.svg, error.png and report.json. Try
    `balloon-warp design toy.obj -o toy`, then `balloon-warp run toy/balloon.toml`.
    """
    from balloon_warp.lab.design.design import design as designed  # loads SciPy and Warp

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
        _say_design(found, output)


def _say_design(found: "Design", output: Path) -> None:
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


RUBBER = "Curve"
"""Heading of a section of the help"""
PROGRESS = ".progress"
"""Suffix of the file beside the data that keeps how far a fit is"""
TABLES = (".csv", ".tsv", ".txt", ".dat")
"""Endings of tables"""
Free = Annotated[
    list[str] | None,
    typer.Option(
        metavar="PATH=LOW:HIGH",
        help="Unknown value of the scene, with bounds: balloon.inflation.moles=0.01:0.1. May be repeated.",
        rich_help_panel=SCENE,
    ),
]
Plot = Annotated[
    Path | None,
    typer.Option(
        "--output", "-o", metavar="FILE", help="Also plot the curve, to this .png file.", rich_help_panel=OUTPUT
    ),
]


@dataclass(frozen=True)
class Rubber:
    """Options of a curve."""

    of: Annotated[
        str,
        typer.Option(
            metavar="sphere|MESH",
            help="Shape that was inflated: a sphere, or a mesh in meters.",
            rich_help_panel=RUBBER,
        ),
    ] = "sphere"
    kind: Annotated[
        str,
        typer.Option(
            metavar="neo_hookean|mooney_rivlin|gent|ogden", help="Material law to fit.", rich_help_panel=RUBBER
        ),
    ] = "mooney_rivlin"
    thickness: Annotated[
        float, typer.Option(metavar="METERS", help="Thickness of the rubber at rest.", rich_help_panel=RUBBER)
    ] = 2e-4
    radius: Annotated[
        float | None,
        typer.Option(
            metavar="METERS", help="Radius of the sphere at rest. Fitted if not given.", rich_help_panel=RUBBER
        ),
    ] = None


def fit(
    data: Annotated[
        Path,
        typer.Argument(
            metavar="TABLE.csv|DATA.npz",
            help="Measured data: a CSV with a head, such as 'volume \\[ml], pressure \\[kPa]' or 'stretch, stress "
            "[MPa]'; or a motion.",
        ),
    ],
    more: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="TABLE.csv|SCENE",
            help="More tables of the same rubber; or the scene that DATA.npz was measured on.",
        ),
    ] = None,
    free: Free = None,
    starts: Annotated[
        int, typer.Option(metavar="COUNT", help="Number of starting points of the search.", rich_help_panel=SCENE)
    ] = 8,
    output: Plot = None,
    resume: Resume = False,
    json: Json = False,
    device: Device = None,
    schedule: Annotated[str, typer.Option(metavar="NAME", hidden=True, rich_help_panel=MACHINE)] = "auto",
    *,
    rubber: Rubber,
) -> None:
    """Fit rubber to measured curves of pressure over volume or stress over stretch, or a scene to a measured motion.

    Try `balloon-warp fit curve.csv --of sphere --thickness 2e-4 --radius 0.05`, or
    `balloon-warp fit uniaxial.csv equibiaxial.csv --kind ogden`, or
    `balloon-warp fit points.npz scene.toml --free balloon.inflation.moles=0.01:0.1`.
    """
    is_curve, others = data.suffix.lower() in TABLES, more or []
    if is_curve and resume:
        raise InputError(f"{data}: a fit to a curve takes seconds; expected no --resume")
    if is_curve and (free or any(Path(each).suffix.lower() not in TABLES for each in others)):
        raise InputError(f"{data}: is a curve; SCENE and --free need a .npz file")
    if not is_curve and not (len(others) == 1 and free):
        raise InputError(
            f"{data}: expected a {', '.join(TABLES)} file of a curve, or a .npz file with a SCENE and "
            "--free PATH=LOW:HIGH"
        )
    if output:
        check_writable(output, (".png",))
    quiet_warp()
    if is_curve:
        of_curves = _of_curves([data, *map(Path, others)], rubber, output)
        _say_fit(of_curves.fit, of_curves.report(), json, of_curves.unit)
        if not json:
            print(f"\n{of_curves.toml}", end="")
        return
    from balloon_warp.lab.fit.fit import fit as fitted

    with stages(data.name) as stage:
        fit_scene = partial(fitted, others[0], data, free=dict(map(_bounds, free or [])), starts=starts)
        found = _of_scene(partial(fit_scene, device=device, schedule=schedule), data, resume, stage)
    unit = "times the noise" if found.noise_known else ""
    _say_fit(found, found.report() | {"misfit_unit": unit}, json, unit)


def _of_curves(paths: list[Path], rubber: Rubber, output: Path | None) -> "CurveFit":
    """Fit a rubber to tables, report their contents, and plot them."""
    from balloon_warp.lab.fit.curve import curves_plot, fit_curves
    from balloon_warp.lab.fit.tables import read_curves

    curves = [curve for path in paths for curve in read_curves(path)]
    for curve in curves:
        note(curve.summary)
    with stages(paths[0].name) as stage:
        found = fit_curves(curves, **vars(rubber), on_stage=stage)
        if output:
            with whole_file(output) as temporary:
                curves_plot(curves, found.loads).save(temporary, format="PNG", pnginfo=png_mark())
    return found


def _of_scene(fit_scene: Callable[..., "Fit"], data: Path, resume: bool, stage: Stages) -> "Fit":
    """Fit a scene; how far it is is kept beside the data, where that can be.

    Args:
        fit_scene: `balloon_warp.fit` with all but what is kept and told.

    Raises:
        StoppedError: Ctrl-C came.
    """
    kept, last = data.with_suffix(PROGRESS), ["before the first round"]
    can_keep = resume or os.access(data.absolute().parent, os.W_OK)

    def on_stage(words: str) -> None:
        last[0] = f"at {words}"
        stage(words)

    try:
        return fit_scene(progress=kept if can_keep else None, resume=resume, on_stage=on_stage)
    except KeyboardInterrupt:
        go_on = f"; --resume continues from {kept}" if can_keep else ""
        raise StoppedError(f"fit was interrupted {last[0]}{go_on}") from None


def _say_fit(found: "Fit", report: dict[str, Any], json: bool, unit: str) -> None:
    if json:
        import json as format_

        print(format_.dumps(report))
        return
    for name, value in found.values.items():
        print(f"{name} = {value:.6g} +- {found.errors[name]:.2g}")
    print(f"misfit {found.misfit:.4g}{'' if unit[:1] in ('', '%') else ' '}{unit}")
    for doubt in found.doubts:
        warn(doubt)


def _bounds(text: str) -> tuple[str, tuple[float, float]]:
    """Read a path and its bounds.

    Raises:
        InputError: the text is none.
    """
    path, _, pair = text.partition("=")
    low, _, high = pair.partition(":")
    try:
        return path, (float(low), float(high))
    except ValueError:
        raise InputError(f"--free {text}: expected PATH=LOW:HIGH, as in balloon.inflation.moles=0.01:0.1") from None
