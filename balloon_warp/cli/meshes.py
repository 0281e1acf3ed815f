"""Commands on meshes: `foil`, `inspect` and `remesh`."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, fields
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from balloon_warp.cli.options import (
    Changes,
    Json,
    MeshOptions,
    PartsOption,
    PrimOption,
    Set,
    UpOption,
    checked_parts,
    checked_up,
)
from balloon_warp.cli.progress import Console, counted, note, stages, unsaid, warn
from balloon_warp.errors import InputError
from balloon_warp.mesh.load import Treatment, in_y_up_meters, load_mesh, prepared
from balloon_warp.mesh.obj import LOADERS, check_materials, write_obj
from balloon_warp.mesh.polygon_mesh import PolygonMesh, with_unit_and_up
from balloon_warp.mesh.thickness import standing, up_axis_sentence
from balloon_warp.scene import Balloon, Scene, bundled_scenes
from balloon_warp.scene.around import scene_of_foil
from balloon_warp.scene.load import override_scene
from balloon_warp.scene.write import write_scene
from balloon_warp.system.files import check_writable, is_same_file, require_ours
from balloon_warp.system.warp_setup import quiet_warp
from balloon_warp.tools.foil import HEIGHT, foil_mesh, foil_parts, joined
from balloon_warp.tools.inspect import Figures, MeshReport, inspect_mesh

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
        from balloon_warp.run.outcomes import predicted_swellings, swelling_sentences
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
        from balloon_warp.run.outcomes import predicted_swellings, swelling_sentences
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
