"""The command `balloon-warp inspect`."""

import json
from collections.abc import Sequence
from dataclasses import asdict, fields
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from balloon_warp.cli.options import (
    Changes,
    Json,
    MeshOptions,
    Set,
)
from balloon_warp.cli.progress import Console, counted, stages, unsaid
from balloon_warp.errors import InputError
from balloon_warp.inspection import Figures, MeshReport, inspect_mesh
from balloon_warp.mesh.load import load_mesh
from balloon_warp.scene import Balloon, Scene, bundled_scenes
from balloon_warp.scene.load import override_scene

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
        from balloon_warp.inspection import (
            advise_step,  # loads Warp: only once the meshes are known to be good
            foretold_swellings,
            sentences,
        )

        stage(STEP_STAGE)
        step = asdict(advise_step(scene))
        stage(SWELLING_STAGE)
        inflation = foretold_swellings(_with_own_step(scene))
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
    rows = {"shows": scene.description, "holds": ", ".join(counts), **_inflation_rows(sentences(inflation))}
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
        from balloon_warp.inspection import advise_step, foretold_swellings, sentences

        try:
            stage("building the scene")
            scene = changes.load(str(mesh))
            alone = {"by itself": scene.description}
            stage(STEP_STAGE)
            step = asdict(advise_step(scene))
            stage(SWELLING_STAGE)
            inflation = foretold_swellings(_with_own_step(scene))
            alone |= _inflation_rows(sentences(inflation))
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
