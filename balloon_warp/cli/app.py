"""Command line: all commands, the report of failures, and commands on the machine, bundled scenes, designs and fits."""

import errno
import json
import os
import signal
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich import box
from rich.table import Table

from balloon_warp.cli.files import check, compare, convert, foil, inspect, remesh, render
from balloon_warp.cli.options import (
    LONG,
    MACHINE,
    OUTPUT,
    SCENE,
    Changes,
    Command,
    Device,
    Json,
    MeshOptions,
    Resume,
    Schedule,
    Set,
    UsageError,
    spread,
    usage_sentence,
)
from balloon_warp.cli.progress import Console, Stages, note, stages, warn, watched, with_options
from balloon_warp.cli.simulate import batch, run, view
from balloon_warp.errors import BlowUpError, InputError, MissingExtraError, StoppedError, WorkersLostError
from balloon_warp.scene.load import bundled_scenes, load_scene, scene_name, scene_toml, write_scene
from balloon_warp.system.files import check_writable, png_mark, whole_file
from balloon_warp.system.process import OutputLostError, lose_output
from balloon_warp.system.warp_setup import quiet_warp

if TYPE_CHECKING:
    from balloon_warp.benchmarks.result import Result
    from balloon_warp.tools.doctor import Report, SelfTest


FILE_WIDTH = 200
"""Width of the table where standard output is no terminal [columns]"""


def bench(
    device: Device = None,
    quick: Annotated[bool, typer.Option("--quick", metavar="", help="Measure a few cases only.")] = False,
    scenes: Annotated[
        bool,
        typer.Option(
            "--scenes", metavar="", help="Measure the bundled scenes instead, in each schedule, alone and in batches."
        ),
    ] = False,
    gpus: Annotated[
        str | None,
        typer.Option(metavar="1,2,4", help="Measure scaling with these numbers of GPUs instead, 8,192 balloons each."),
    ] = None,
    workers: Annotated[
        str | None,
        typer.Option(metavar="1,2", help="Measure scaling with these numbers of processes instead, 64 balloons each."),
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output", "-o", metavar="FILE", help="Also write the results, to this .json file.", rich_help_panel=OUTPUT
        ),
    ] = None,
    as_json: Json = False,
) -> None:
    """Benchmark the machine, side by side with Newton and Blender's cloth where they are installed.

    The table is Markdown. Rates are in particle-substeps a second, unless the case names another unit.
    """
    quiet_warp()
    from balloon_warp.benchmarks.auto import scene_results
    from balloon_warp.benchmarks.run import run_cases
    from balloon_warp.benchmarks.scaling import CPU_SHARE, GPU_SHARES, measure_scaling
    from balloon_warp.system.warp_threads import pick_device

    if output:
        check_writable(output, (".json",))
    if sum(choice is not None for choice in (device, gpus, workers)) > 1:
        raise InputError("--device, --gpus, --workers: expected only one of them")
    if sum((quick, scenes, bool(gpus or workers))) > 1:
        raise InputError("--quick, --scenes, and --gpus or --workers: expected only one of them")
    if gpus or workers:
        counts = _counts(gpus or workers or "")
        measured = (
            result for share in (GPU_SHARES if gpus else [CPU_SHARE]) for result in measure_scaling(share, counts)
        )
    else:
        measured = scene_results(pick_device(device)) if scenes else run_cases(pick_device(device), quick)
    progress = Console(emoji=False, stderr=True, highlight=False)
    results = []
    for result in measured:
        progress.print(f"{result.case} ({result.schedule}): {result.rate:.3g}", style="dim", markup=False)
        results.append(result)
    written = json.dumps([result.as_json() for result in results], indent=1)
    if as_json:
        print(written)
    else:
        _print_table(results)
    if output:
        with whole_file(output) as file:
            file.write_text(f"{written}\n", encoding="utf-8")


def _print_table(results: Sequence["Result"]) -> None:
    """Print a line for each case, as Markdown."""
    table = Table(box=box.MARKDOWN)
    for header in (
        "case",
        "schedule",
        "worlds",
        "particles",
        "rate",
        "peer",
        "its rate",
        "ratio",
        "of the bound",
        "overlap",
    ):
        table.add_column(header, justify="left" if header in ("case", "schedule", "peer") else "right", no_wrap=True)
    for result in results:
        table.add_row(
            result.case.replace("[", r"\["),
            result.schedule,
            f"{result.worlds:,}",
            f"{result.particles:,}",
            f"{result.rate:.3g}",
            result.peer or "-",
            f"{result.peer_rate:.3g}" if result.peer_rate else "-",
            f"{result.ratio:.3g}" if result.ratio else "-",
            f"{result.bound_fraction:.0%}" if result.bound_fraction else "-",
            " / ".join(f"{each:.1%}" for each in (result.overlap, result.peer_overlap) if each is not None) or "-",
        )
    console = Console(emoji=False, highlight=False)
    (console if console.is_terminal else Console(emoji=False, highlight=False, width=FILE_WIDTH)).print(table)


def _counts(text: str) -> list[int]:
    """Read the numbers of `1,2,4`."""
    try:
        return [int(word) for word in text.split(",")]
    except ValueError:
        raise InputError(f"--gpus, --workers: expected numbers such as 1,2,4 (got {text})") from None


def doctor(device: Device = None, as_json: Json = False) -> None:
    """Report the installation, the default device and missing extras, and run a self-test of one second.

    The exit status is 1 if the test fails.
    """
    quiet_warp()
    from balloon_warp.tools.doctor import examine  # loads Warp

    report = examine(device)
    if as_json:
        print(json.dumps(report.as_json(), indent=2))
    else:
        _print(report, Console(emoji=False, highlight=False, soft_wrap=True))
    if not report.self_test.passed:
        raise typer.Exit(1)


def _print(report: "Report", console: Console) -> None:
    lines = {
        "versions": ", ".join(f"{name} {version}" for name, version in report.versions.items()),
        "system": report.system,
        "device": f"{report.device}; Warp sees {', '.join(report.devices)}",
        "kernels": f"cached in {report.kernel_cache}",
        **{f"extra {name}": _extra(name, missing) for name, missing in report.missing.items()},
        "self-test": _verdict(report.self_test),
    }
    for name, said in lines.items():
        console.print(f"{name:<14} {said}", markup=False)


def _extra(name: str, missing: list[str]) -> str:
    return f"missing {', '.join(missing)}: pip install 'balloon-warp[{name}]'" if missing else "installed"


def _verdict(test: "SelfTest") -> str:
    found = f"fell {test.fallen:.5f} m in a second (expected {test.expected:.5f} m) and grew to {test.grown:.2f} times"
    word = "passed" if test.passed else "FAILED"
    return f"{word} in {test.seconds:.1f} s: a balloon {found} its volume"


def kernel(
    scene: Annotated[str, typer.Argument(metavar="SCENE", help="A bundled scene, a scene file, or a mesh.")],
    overrides: Set = None,
    *,
    mesh: MeshOptions,
    schedule: Annotated[
        str,
        typer.Option(metavar="NAME", help="Schedule: gather, scatter, block, lanes or octets."),
    ] = "gather",
) -> None:
    """Print the source of a scene's kernels: the substep in readable form.

    Try `balloon-warp kernel squirrel_tether`.
    """
    loaded = Changes(overrides, mesh).load(scene)
    quiet_warp()
    from balloon_warp.tools.doctor import kernel_source  # loads Warp: only once the scene is known to be good

    print(kernel_source(loaded, schedule), end="")


def scenes(
    scene: Annotated[
        str | None,
        typer.Argument(
            help="Bundled scene, scene file or mesh to start your own scene from. If not given, "
            "all bundled scenes are listed.",
            metavar="SCENE",
        ),
    ] = None,
    *,
    mesh: MeshOptions,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="FILE", help="Scene file to write, .toml. If not given, it is printed."),
    ] = None,
) -> None:
    """List the bundled scenes, or write one as a file to edit.

    Try `balloon-warp scenes squirrel_tether -o mine.toml`, then `balloon-warp run mine.toml`.
    """
    if scene is None:
        if output or mesh.inflate is not None:
            option = f"--output {output}" if output else f"--inflate {mesh.inflate:g}"
            raise InputError(f"{option}: needs a SCENE to write")
        _list_scenes()
        return
    loaded = Changes(mesh=mesh).load(scene)
    if output is None:
        print(scene_toml(loaded, Path()), end="")
        return
    for path in write_scene(loaded, output):
        Console(emoji=False, highlight=False, soft_wrap=True).print(f"wrote {path}", markup=False)


def _list_scenes() -> None:
    table = Table(box=None, pad_edge=False)
    table.add_column("scene", style="bold", no_wrap=True)
    table.add_column("what it shows")
    for name in bundled_scenes():
        table.add_row(name, load_scene(name).description)
    Console(emoji=False, highlight=False).print(table)


def warm_up(
    scenes: Annotated[
        list[str] | None,
        typer.Argument(metavar="SCENE", help="Bundled scenes, scene files or meshes. All bundled scenes if not given."),
    ] = None,
    worlds: Annotated[int, typer.Option(metavar="COUNT", help="Approximate number of worlds of a later batch.")] = 1,
    device: Device = None,
    schedule: Schedule = "auto",
) -> None:
    """Compile the kernels of scenes ahead of time, so that a later command starts at once.

    Try `balloon-warp warm-up squirrel_tether`. WARP_CACHE_PATH sets the folder of kernels, such as in an image.
    """
    loaded = {scene: load_scene(scene) for scene in scenes or bundled_scenes()}
    quiet_warp()
    from balloon_warp.tools import doctor

    console = Console(emoji=False, highlight=False, soft_wrap=True)
    for source, scene in loaded.items():
        done = doctor.warm_up(scene, device, worlds, schedule)
        console.print(
            f"{scene_name(source)}: ready in {done.seconds:.1f} s on {done.device}, schedule {done.schedule}",
            markup=False,
        )


def _print_version(wanted: bool) -> None:
    if wanted:
        print(metadata.version("balloon-warp"))
        raise typer.Exit


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


@dataclass(frozen=True)
class WatchOptions:
    """Options of the page of a design."""

    view: View = False
    port: Port = None


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
    *,
    page: WatchOptions,
    wanted: DesignOptions,
) -> None:
    """Design the balloon that inflates to a target shape, and simulate it from rest.

    DIR gets balloon.toml, which runs as it is, springs.npz, mould.stl or pattern.svg, error.png and report.json. Try
    `balloon-warp design toy.obj -o toy`, then `balloon-warp run toy/balloon.toml`.
    """
    from balloon_warp.lab.design.design import design as designed  # loads SciPy and Warp

    quiet_warp()
    if page.view and wanted.of == "foil" and wanted.panels is None:
        raise InputError("--view: needs --of springs, --of latex or panels of foil (got --of foil without --panels)")
    asked = {**vars(wanted), "thickness": _thickness(wanted.thickness), "fixed": _fixed(wanted.fixed)}
    last = ["before the first step"]
    with watched(page.view, page.port, Path(target).name) as watch, stages(Path(target).name) as stage:

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


@dataclass(frozen=True)
class SearchOptions:
    """Options of a scene's unknown values."""

    free: Free = None
    starts: Annotated[
        int, typer.Option(metavar="COUNT", help="Number of starting points of the search.", rich_help_panel=SCENE)
    ] = 8


@dataclass(frozen=True)
class SearchRunOptions:
    """Options of the run of a search."""

    resume: Resume = False
    device: Device = None
    schedule: Annotated[str, typer.Option(metavar="NAME", hidden=True, rich_help_panel=MACHINE)] = "auto"


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
    *,
    search: SearchOptions,
    output: Plot = None,
    json: Json = False,
    search_run: SearchRunOptions,
    rubber: Rubber,
) -> None:
    """Fit rubber to measured curves of pressure over volume or stress over stretch, or a scene to a measured motion.

    Try `balloon-warp fit curve.csv --of sphere --thickness 2e-4 --radius 0.05`, or
    `balloon-warp fit uniaxial.csv equibiaxial.csv --kind ogden`, or
    `balloon-warp fit points.npz scene.toml --free balloon.inflation.moles=0.01:0.1`.
    """
    is_curve, others = data.suffix.lower() in TABLES, more or []
    if is_curve and search_run.resume:
        raise InputError(f"{data}: a fit to a curve takes seconds; expected no --resume")
    if is_curve and (search.free or any(Path(each).suffix.lower() not in TABLES for each in others)):
        raise InputError(f"{data}: is a curve; SCENE and --free need a .npz file")
    if not is_curve and not (len(others) == 1 and search.free):
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
        fit_scene = partial(fitted, others[0], data, free=dict(map(_bounds, search.free or [])), starts=search.starts)
        found = _of_scene(
            partial(fit_scene, device=search_run.device, schedule=search_run.schedule), data, search_run.resume, stage
        )
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


WRITERS = (run, batch, compare, scenes, remesh, foil, design, fit, render, convert)
"""Commands that choose names of files themselves"""
app = typer.Typer(
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
for command in (
    run,
    view,
    batch,
    compare,
    scenes,
    inspect,
    remesh,
    foil,
    design,
    fit,
    render,
    check,
    convert,
    warm_up,
    kernel,
    bench,
    doctor,
):
    app.command(cls=Command)(spread(command, writes=command in WRITERS))


@app.callback()
def balloon_warp(
    version: Annotated[
        bool,
        typer.Option(
            "--version", metavar="", help="Print the version and stop.", callback=_print_version, is_eager=True
        ),
    ] = False,
) -> None:
    """Simulate balloons: any mesh in, animated USD out.

    Try `balloon-warp run squirrel_tether --picture`. `balloon-warp COMMAND --help` explains a command.
    """


def main() -> None:
    """Run a command; without one, print the help.

    A user's mistake becomes one sentence on standard error and exit status 2, as does standard output that is full; a
    blow-up or the loss of all workers, 1; Ctrl-C, 130; SIGTERM, 143.
    """
    for stream in (sys.stdout, sys.stderr):
        if reconfigure := getattr(stream, "reconfigure", None):
            reconfigure(errors="backslashreplace")  # a terminal or log that is not UTF-8 loses letters, no work
    signals: list[int] = []

    def stop(number: int, _: object) -> None:
        signals.append(number)
        raise KeyboardInterrupt  # so that half-written files are removed

    heard = [number for number in (signal.SIGINT, signal.SIGTERM) if signal.getsignal(number) != signal.SIG_IGN]
    before = {number: signal.signal(number, stop) for number in heard}  # a process in the background ignores Ctrl-C
    try:
        status = app(sys.argv[1:] or ["--help"], standalone_mode=False)
        if sys.stdout is not None:
            sys.stdout.flush()
    except UsageError as mistake:
        _fail(usage_sentence(mistake, typer.main.get_command(app), sys.argv[1:]), status=2)
    except (InputError, MissingExtraError) as mistake:
        _fail(mistake, status=2)
    except (BlowUpError, WorkersLostError) as failure:
        _fail(failure, status=1)
    except MemoryError as failure:
        _fail(f"memory is exhausted{f' ({failure})' if str(failure) else ''}; less may be asked for", status=1)
    except StoppedError as stopped:
        _fail(stopped, status=128 + (signals or [signal.SIGINT])[0])
    except OutputLostError as lost:
        lose_output()
        if lost.errno == errno.EPIPE:  # whoever read it has enough
            sys.exit(1)
        _fail(f"standard output: cannot be written: {lost.strerror}", status=2)
    else:
        if status == 128 + signal.SIGINT:  # Typer's form of a KeyboardInterrupt
            _fail(f"{sys.argv[1]} was interrupted", status=128 + (signals or [signal.SIGINT])[0])
        sys.exit(status)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def _fail(error: Exception | str, status: int) -> None:
    Console(emoji=False, stderr=True, soft_wrap=True, highlight=False).print(
        "[bold red]error:[/]", with_options(str(error)).replace("[", r"\[")
    )
    sys.exit(status)


if TYPE_CHECKING:
    from balloon_warp.lab.design.job import Design
    from balloon_warp.lab.fit.curve import CurveFit
    from balloon_warp.lab.fit.fit import Fit
