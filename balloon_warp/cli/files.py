"""Commands on meshes and on written stages: `foil`, `inspect`, `remesh`, `check`, `compare`, `convert`, `render`."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from functools import partial
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
    MeshOptions,
    PartsOption,
    PrimOption,
    RenderDevice,
    SceneName,
    Schedule,
    Set,
    Size,
    UpOption,
    checked_parts,
    checked_up,
    own_name,
    parse_frames,
    parse_size,
)
from balloon_warp.cli.progress import Console, begun, counted, frame_progress, note, stages, unsaid, warn
from balloon_warp.errors import InputError
from balloon_warp.mesh.load import Treatment, in_y_up_meters, load_mesh, prepared
from balloon_warp.mesh.obj import LOADERS, check_materials, write_obj
from balloon_warp.mesh.polygon_mesh import PolygonMesh, with_unit_and_up
from balloon_warp.mesh.thickness import standing, up_axis_sentence
from balloon_warp.scene import Balloon, Scene, bundled_scenes
from balloon_warp.scene.around import scene_of_foil
from balloon_warp.scene.load import override_scene, scene_name, write_scene
from balloon_warp.system.files import check_writable, is_same_file, require_ours
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.tools.foil import HEIGHT, foil_mesh, foil_parts, joined
from balloon_warp.tools.inspect import Figures, MeshReport, inspect_mesh

if TYPE_CHECKING:
    from balloon_warp.tools.check import CheckReport, Crossing
    from balloon_warp.tools.compare import Comparison


SCENE, MESH = ".toml", ".obj"
SceneOf = Callable[[Mapping[Path, PolygonMesh]], Scene]
"""Function from meshes, by their files, to a scene"""
Edge = Annotated[
    float | None,
    typer.Option(
        metavar="METERS", help="Approximate edge length of the quads. If not given, a 32nd of the height or less."
    ),
]
Font = Annotated[
    str | None,
    typer.Option(metavar="FONT", help="A .ttf or .otf file, or the name of a font. DejaVu Sans Bold if not given."),
]


def foil(
    source: Annotated[str, typer.Argument(metavar="TEXT|DRAWING", help="Letters, or an .svg file.")],
    output: Annotated[
        Path,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="Mesh to write, .obj; or scene, .toml, in which each letter or part is a balloon that inflates, "
            "with its meshes beside it.",
        ),
    ],
    height: Annotated[
        float | None,
        typer.Option(
            metavar="METERS", help=f"Height of the whole text or drawing, flat. {HEIGHT:g} if neither size is given."
        ),
    ] = None,
    inflated_size: Annotated[
        float | None,
        typer.Option(
            "--inflated-size",
            metavar="METERS",
            help="Largest dimension of the inflated outline. The flat outline is corrected until it inflates to "
            "the drawn one; a scene is then of film, without strings.",
        ),
    ] = None,
    edge: Edge = None,
    font: Font = None,
    apart: Annotated[
        bool,
        typer.Option("--apart", metavar="", help="Write a file for each letter or part: FILE_1.obj and so on."),
    ] = False,
) -> None:
    """Make a foil balloon of letters or a drawing: two flat sheets of even quads, sewn at the rim.

    Try `balloon-warp foil HEY -o hey.toml`, then `balloon-warp run hey.toml --picture`. This needs the extra `foil`.
    """
    check_writable(output, (*LOADERS, SCENE))
    if output.suffix.lower() == SCENE:
        require_ours(output)
    if height is not None and inflated_size is not None:
        raise InputError("--inflated-size, --height: expected only one of them, the inflated size or the flat height")
    in_files = apart or output.suffix.lower() == SCENE
    if inflated_size is not None:
        parts, scene = _of_inflated_size(source, inflated_size, edge, font)
    else:
        flat = HEIGHT if height is None else height
        parts = foil_parts(source, flat, edge, font) if in_files else [foil_mesh(source, flat, edge, font)]
        scene = partial(scene_of_foil, height=flat)
    _write(parts if in_files else [joined(parts, Path(source).stem)], output, in_files, scene)


def _of_inflated_size(
    source: str, size: float, edge: float | None, font: str | None
) -> tuple[list[PolygonMesh], SceneOf]:
    """Return the parts that have the drawn outline once they are inflated, and how they make a scene."""
    from balloon_warp.lab.design.foil import foil_of_inflated_size  # loads Warp

    quiet_warp()
    with stages(source) as stage:
        found, parts = foil_of_inflated_size(source, size, edge, font, stage)
        stage.end()
    return parts, lambda meshes: found.scene(list(meshes.values()), list(meshes))


def _write(parts: list[PolygonMesh], output: Path, apart: bool, scene_of: SceneOf) -> None:
    """Write the meshes, each in a file of its own or one in OUTPUT, and the scene."""
    is_scene = output.suffix.lower() == SCENE
    meshes = {output: parts[0]}
    if apart:
        meshes = {output.with_name(f"{output.stem}_{number}{MESH}"): part for number, part in enumerate(parts, start=1)}
        for path in meshes:
            require_ours(path)
    for path, mesh in meshes.items():
        write_obj(path, mesh)
        print(f"wrote {path}: {mesh.vertex_count:,} vertices, {mesh.face_count:,} quads")
    if is_scene:
        write_scene(scene_of(meshes), output)
        print(f"wrote {output}: balloon-warp run {output} inflates the balloons")


STEP_STAGE = "finding the largest stable step"
SWELLING_STAGE = "predicting the inflated volume"
THINGS = ("balloon", "sphere", "string", "tube", "force", "obstacle", "body", "change")
"""Tables of a scene that are counted"""


def inspect(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SCENE|MESH",
            help="A bundled scene, a scene file, or a mesh: OBJ, USD, STL, PLY, OFF, glTF or GLB.",
        ),
    ],
    overrides: Set = None,
    *,
    mesh: MeshOptions,
    as_json: Json = False,
) -> None:
    """Report faces, springs, size, defects and the largest stable step of a mesh or a scene.

    Try `balloon-warp inspect YOUR_MESH.obj`.
    """
    changes = Changes(overrides, mesh)
    if source in bundled_scenes() or Path(source).suffix.lower() == ".toml" or not Path(source).exists():
        _inspect_scene(source, changes.load(source), as_json)
    else:
        _inspect_mesh(Path(source), changes, as_json)


def _inspect_scene(source: str, scene: Scene, as_json: bool) -> None:
    paths = [(balloon.mesh, balloon) for balloon in scene.balloon if isinstance(balloon.mesh, Path)]
    meshes = [(path, balloon.treatment, balloon.unit, _prims(balloon)) for path, balloon in paths]
    reports = {}
    with stages(source) as stage:
        for mesh in dict.fromkeys(meshes):
            stage(f"checking {mesh[0].name} and building springs")
            reports[mesh] = inspect_mesh(load_mesh(mesh[0], mesh[3]), *mesh[:2])
        from balloon_warp.run.report import predicted_swellings, swelling_sentences
        from balloon_warp.tools.inspect import advise_step  # loads Warp: only once the meshes are known to be good

        stage(STEP_STAGE)
        step = asdict(advise_step(scene))
        stage(SWELLING_STAGE)
        inflation = predicted_swellings(_with_own_step(scene))
    if as_json:
        balloons = [{"mesh": str(mesh[0]), **asdict(reports[mesh])} for mesh in meshes]
        print(
            json.dumps(
                {
                    "description": scene.description,
                    "balloons": balloons,
                    "step": step,
                    "inflation": [asdict(each) for each in inflation],
                }
            )
        )
        return
    counts = [counted(len(many), name) for name in THINGS if (many := getattr(scene, name))]
    console = _console()
    rows = {"shows": scene.description, "holds": ", ".join(counts), **_inflation_rows(swelling_sentences(inflation))}
    console.print(_table(source, {**rows, **_step_rows(step)}))
    _print_warnings(console, step["doubts"])
    for (mesh, _, unit, _), report in reports.items():
        console.print()
        _print_mesh(console, mesh.name, report, unit, {})


def _inspect_mesh(mesh: Path, changes: Changes, as_json: bool) -> None:
    """Inspect a mesh; the step is that of the scene that a mesh by itself gets.

    A mesh of which that makes no balloon is reported on first, and then refused.
    """
    balloon = changes.balloon_of(mesh)
    step, inflation, alone, refusal = None, [], {}, None
    with stages(mesh.name) as stage:
        stage("reading the mesh")
        whole = load_mesh(mesh, balloon.prim)
        stage("checking the mesh and building springs")
        report = inspect_mesh(whole, mesh, balloon.treatment)
        from balloon_warp.run.report import predicted_swellings, swelling_sentences
        from balloon_warp.tools.inspect import advise_step

        try:
            stage("building the scene")
            scene = changes.load(str(mesh))
            alone = {"by itself": scene.description}
            stage(STEP_STAGE)
            step = asdict(advise_step(scene))
            stage(SWELLING_STAGE)
            inflation = predicted_swellings(_with_own_step(scene))
            alone |= _inflation_rows(swelling_sentences(inflation))
        except InputError as mistake:
            refusal = mistake
    if as_json:
        print(json.dumps({**asdict(report), "step": step, "inflation": [asdict(each) for each in inflation]}))
    else:
        more = {**alone, **(_step_rows(step) if step else {})}
        doubts = unsaid(alone.get("by itself"), step["doubts"] if step else ())
        _print_mesh(_console(), mesh.name, report, balloon.unit, more, doubts)
    if refusal:
        raise refusal


def _prims(balloon: Balloon) -> str | tuple[str, ...] | None:
    """Return the prims of a stage that a balloon names."""
    return tuple(balloon.prim) if isinstance(balloon.prim, list) else balloon.prim


def _console() -> Console:
    return Console(emoji=False, highlight=False, soft_wrap=True)


def _print_mesh(
    console: Console, name: str, report: MeshReport, unit: str | None, more: dict[str, str], doubts: Sequence[str] = ()
) -> None:
    """Print a table of a mesh.

    Args:
        unit: of the mesh's numbers, if that is known.
        more: rows that follow.
        doubts: warnings beside those about the mesh.
    """
    springs = report.springs
    of_kinds = f"{springs.structural:,} structural, {springs.shear:,} shear, {springs.flexion:,} flexion"
    holding = f"; {springs.holding:,} hold parts together" if springs.holding else ""
    total = springs.structural + springs.shear + springs.flexion
    figures = {field.name: getattr(report, field.name) for field in fields(Figures)}
    rows, in_file = (_mesh_rows(Figures(**each), unit) for each in (figures, {**figures, **report.in_file}))
    said = {
        label: row if row == in_file[label] else f"{row}; in the file: {in_file[label]}" for label, row in rows.items()
    }
    console.print(_table(name, {**said, "springs": f"{total:,} ({of_kinds}{holding})", **more}))
    _print_warnings(console, [*doubts, *report.warnings])


def _print_warnings(console: Console, warnings: Sequence[str]) -> None:
    for warning in warnings:
        console.print(f"[yellow]warning:[/] {escape(warning)}")


def _mesh_rows(mesh: Figures, unit: str | None) -> dict[str, str]:
    square, cubic = (f"{unit}²", f"{unit}³") if unit else ("square units", "cubic units")
    of_sizes = f"{mesh.triangles:,} triangles, {mesh.quads:,} quads, {mesh.ngons:,} n-gons"
    return {
        "vertices": f"{mesh.vertices:,}" + (f", {mesh.unused_vertices:,} unused" if mesh.unused_vertices else ""),
        "faces": f"{mesh.faces:,} ({of_sizes})",
        "closed": "yes" if mesh.closed else f"no, {counted(mesh.border_edges, 'border edge')}",
        "manifold": "yes" if mesh.manifold else "no",
        "components": f"{mesh.components:,}",
        "genus": "-" if mesh.genus is None else f"{mesh.genus:,}",
        "volume": "-" if mesh.volume is None else f"{mesh.volume:,.6g} {cubic}",
        "area": f"{mesh.area:,.6g} {square}",
    }


def _with_own_step(scene: Scene) -> Scene:
    """Return the scene with as many substeps as it needs, if it asks for fewer."""
    return override_scene(scene, [("substeps", "auto")])


def _inflation_rows(sentences: Sequence[str]) -> dict[str, str]:
    return {"inflation": "; ".join(sentences)} if sentences else {}


def _step_rows(step: dict) -> dict[str, str]:
    up_to = f"stable up to {step['stable_step']:.3g} s: {step['least_substeps']:,} substeps a frame"
    auto = f'{step["substeps"]:,} with "auto"'
    rate = f"at {step['frames_per_second']:g} frames/s"
    if step["solver"] == "projective":
        return {"step": f"stable at any step: {auto} {rate}", "explicit": f"{up_to} {rate}"}
    place = ", ".join(f"{coordinate:.3g}" for coordinate in step["limiting_place"])
    particle = f"particle {step['limiting_particle']:,} of {step['limiting_balloon']}, at ({place}) m"
    if step["limiting_body"] is not None:
        particle = f"body {step['limiting_body']}, by the strings that are tied to it"
    if step["many_substeps"]:
        particle += f". {step['many_substeps']}"
    strain_bound = {"film": step["strain_bound"]} if step["strain_bound"] else {}
    return {"step": f"{up_to} {rate}, {auto}", "limited by": particle, **strain_bound}


def _table(name: str, rows: dict[str, str]) -> Table:
    table = Table(title=escape(name), title_justify="left", title_style="bold", box=None, show_header=False)
    table.add_column(style="dim")
    table.add_column()
    for label, value in rows.items():
        table.add_row(label, escape(value))
    return table


def remesh(
    mesh: Annotated[Path, typer.Argument(metavar="MESH", help="Mesh to read: OBJ, USD, STL, PLY, OFF, glTF or GLB.")],
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="Mesh to write, an .obj file.")],
    cells: Annotated[
        int, typer.Option(metavar="COUNT", help="Approximate number of quads along the longest side, 4 to 256.")
    ] = 48,
    parts: PartsOption = None,
    prim: PrimOption = None,
    up: UpOption = None,
) -> None:
    """Remesh any surface into a closed mesh of even quads, as a balloon needs; Y is up in it.

    Try `balloon-warp remesh YOUR_MESH.stl -o quads.obj`, then `balloon-warp run quads.obj`.
    """
    check_writable(output, tuple(LOADERS))
    if is_same_file(output, mesh):
        raise InputError(f"{output}: is the input mesh; expected another name, with -o")
    said = checked_up(up)
    with stages(mesh.name) as stage:
        stage("reading the mesh")
        surface = load_mesh(mesh, prim)
        axis, why = (None if said else standing(surface, mesh.suffix)) or (said, None)
        surface = with_unit_and_up(surface, None, axis)
        if taken := checked_parts(parts):
            surface = prepared(surface, mesh, Treatment(taken=taken))
        if surface.looks is not None:
            check_materials(output)
        quiet_warp()
        from balloon_warp.tools.remesh import remesh as remeshed  # loads Warp: only once there is a mesh

        quads = in_y_up_meters(remeshed(surface, cells, on_stage=stage))
        stage("writing it")
        write_obj(output, quads)
    if why or surface.up_axis == "Z":
        note(f"{mesh.name}: {up_axis_sentence(surface, said is not None, why)}")
    for warning in quads.warnings:
        warn(warning)
    print(f"wrote {output}: {quads.vertex_count:,} vertices, {quads.face_count:,} quads")


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


@dataclass(frozen=True)
class SheetOptions:
    """Options of the picture and table of a comparison."""

    output: Picture = None
    table: TableFile = None
    frame: Frame = None
    size: Size = "480x270"


def compare(
    scene: SceneName,
    vary: Vary = None,
    overrides: Set = None,
    *,
    length: LengthOptions,
    sheet: SheetOptions,
    device: Device = None,
    schedule: Schedule = "auto",
) -> None:
    """Compare runs of a scene with different values: one picture, one table.

    Try `balloon-warp compare squirrel_inflate --vary balloon.mass=1,2,4`.
    """
    loaded, name = Changes(overrides, length=length).load(scene), scene_name(scene)
    if not vary:
        raise InputError("--vary: is missing; expected a value to vary, as in --vary normals=cached,fresh")
    picture = sheet.output or own_name(Path(f"{name}_compare.png"), loaded)
    quiet_warp()
    from balloon_warp.tools.compare import compare as run_all  # loads Warp and USD: only for a good scene
    from balloon_warp.tools.compare import parse_choices

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
            table=sheet.table,
            frame=sheet.frame,
            size=parse_size(sheet.size),
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
    from balloon_warp.tools.compare import shown  # has been loaded by the comparison

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
    from balloon_warp.studio.export import export_stage

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


@dataclass(frozen=True)
class PictureOptions:
    """Options of a picture or an animation."""

    frame: Annotated[
        int | None,
        typer.Option(
            metavar="NUMBER",
            help="Frame that a .png shows. If not given, the stage's picture frame, or the last.",
        ),
    ] = None
    size: Annotated[str, typer.Option(metavar="WIDTHxHEIGHT", help="Size of the picture in pixels.")] = "960x540"
    frames: Annotated[
        str | None, typer.Option(metavar="FIRST:LAST", help="Range of frames of an animation, such as 10:90.")
    ] = None
    fps: Annotated[
        float | None,
        typer.Option(metavar="RATE", help="Frame rate of the animation, which keeps its true speed."),
    ] = None
    samples: Annotated[int, typer.Option(metavar="COUNT", help="Rays per pixel. More is smoother and slower.")] = 4


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
    pictures: PictureOptions,
    camera: CameraOptions,
    device: RenderDevice = None,
) -> None:
    """Render a picture or an animation of a stage. No display is needed.

    Try `balloon-warp render squirrel_tether.usdc -o squirrel.mp4 --azimuth 90`.
    """
    asked = camera.asked()
    pixels = parse_size(pictures.size)
    part = parse_frames(pictures.frames) if pictures.frames else None
    quiet_warp()
    from balloon_warp.studio.render import render_stage  # loads USD: only once the arguments are known to be good

    picture = output or own_name(Path(stage.with_suffix(".png").name))
    terminal = Console(emoji=False, stderr=True)
    with Progress(console=terminal, disable=not terminal.is_terminal, transient=True) as progress:
        task = progress.add_task(picture.name, total=None)
        render_stage(
            stage,
            picture,
            frame=pictures.frame,
            size=pixels,
            samples=pictures.samples,
            device=device,
            frames=part,
            frames_per_second=pictures.fps,
            on_frame=lambda done, count: progress.update(task, completed=done, total=count),
            on_note=warn,
            **asked,
        )
    Console(emoji=False, highlight=False, soft_wrap=True).print(f"wrote {picture}", markup=False)
