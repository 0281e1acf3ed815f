"""`balloon-warp inspect`"""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from balloon_warp.cli.options import WELD, UnitOption, Weld, scene_changes
from balloon_warp.cli.words import counted
from balloon_warp.errors import InputError
from balloon_warp.inspection import MeshReport, inspect_mesh
from balloon_warp.mesh.load import load_mesh
from balloon_warp.scene import Scene, bundled_scenes, load_scene
from balloon_warp.scene.overrides import Override


def inspect(
    source: Annotated[
        str,
        typer.Argument(
            metavar="SCENE|MESH",
            help="A bundled scene, a scene file, or a mesh: OBJ or USD; STL, PLY, OFF, glTF and GLB as triangles.",
        ),
    ],
    overrides: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="PATH=VALUE", help="Change a value, for the step: --set balloon.mass=2"),
    ] = None,
    weld: Weld = False,
    unit: UnitOption = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON on standard output.")] = False,
) -> None:
    """Report the faces, springs, topology and size of meshes, what is odd about them, and the step that they allow."""
    changes = scene_changes(overrides, weld, unit)
    if source in bundled_scenes() or Path(source).suffix.lower() == ".toml" or not Path(source).exists():
        _inspect_scene(source, load_scene(source, changes), as_json)
    else:
        _inspect_mesh(Path(source), changes, as_json)


def _inspect_scene(source: str, scene: Scene, as_json: bool) -> None:
    meshes = [(balloon.mesh, balloon.weld) for balloon in scene.balloon if isinstance(balloon.mesh, Path)]
    reports = {mesh: inspect_mesh(load_mesh(*mesh), mesh[0]) for mesh in dict.fromkeys(meshes)}
    from balloon_warp.advice import advise_step  # loads Warp: only once the meshes are known to be good

    step = asdict(advise_step(scene))
    if as_json:
        balloons = [{"mesh": str(mesh[0]), **asdict(reports[mesh])} for mesh in meshes]
        print(json.dumps({"description": scene.description, "balloons": balloons, "step": step}))
        return
    things = {"balloon": scene.balloon, "sphere": scene.sphere, "string": scene.string}
    counts = [counted(len(many), name) for name, many in things.items() if many]
    console = _console()
    console.print(_table(source, {"shows": scene.description, "holds": ", ".join(counts), **_step_rows(step)}))
    for (mesh, _), report in reports.items():
        console.print()
        _print_mesh(console, mesh.name, report, {})


def _inspect_mesh(mesh: Path, changes: list[Override], as_json: bool) -> None:
    """The step is that of the scene that a mesh by itself gets."""
    report = inspect_mesh(load_mesh(mesh, weld=WELD in changes), mesh)
    from balloon_warp.advice import advise_step

    step, alone = None, {}
    try:
        scene = load_scene(str(mesh), changes)
        alone = {"by itself": scene.description}
        step = asdict(advise_step(scene))
    except InputError as mistake:
        if changes:
            raise
        report.warnings.append(f"It makes no balloon as it is: {mistake}")
    if as_json:
        print(json.dumps({**asdict(report), "step": step}))
    else:
        _print_mesh(_console(), mesh.name, report, {**alone, **(_step_rows(step) if step else {})})


def _console() -> Console:
    return Console(highlight=False, soft_wrap=True)


def _print_mesh(console: Console, name: str, report: MeshReport, more: dict[str, str]) -> None:
    springs = report.springs
    of_sizes = f"{report.triangles:,} triangles, {report.quads:,} quads, {report.ngons:,} n-gons"
    of_kinds = f"{springs.structural:,} structural, {springs.shear:,} shear, {springs.flexion:,} flexion"
    rows = {
        "vertices": f"{report.vertices:,}" + (f", {report.unused_vertices:,} unused" if report.unused_vertices else ""),
        "faces": f"{report.faces:,} ({of_sizes})",
        "springs": f"{springs.structural + springs.shear + springs.flexion:,} ({of_kinds})",
        "closed": "yes" if report.closed else f"no, {report.border_edges:,} border edges",
        "manifold": "yes" if report.manifold else "no",
        "components": f"{report.components:,}",
        "genus": "-" if report.genus is None else f"{report.genus:,}",
        "volume": "-" if report.volume is None else f"{report.volume:,.6g} cubic units",
        "area": f"{report.area:,.6g} square units",
    }
    console.print(_table(name, {**rows, **more}))
    for warning in report.warnings:
        console.print(f"[yellow]warning:[/] {escape(warning)}")


def _step_rows(step: dict) -> dict[str, str]:
    up_to = f"stable up to {step['stable_step']:.3g} s: {step['least_substeps']:,} substeps a frame"
    auto = f'{step["substeps"]:,} with "auto"'
    rate = f"at {step['frames_per_second']:g} frames/s"
    if step["solver"] == "projective":
        return {"step": f"stable, however long: {auto} {rate}", "explicit": f"{up_to} {rate}"}
    place = ", ".join(f"{coordinate:.3g}" for coordinate in step["limiting_place"])
    particle = f"particle {step['limiting_particle']:,} of {step['limiting_balloon']}, at ({place}) m"
    return {"step": f"{up_to} {rate}, {auto}", "limited by": particle}


def _table(name: str, rows: dict[str, str]) -> Table:
    table = Table(title=escape(name), title_justify="left", title_style="bold", box=None, show_header=False)
    table.add_column(style="dim")
    table.add_column()
    for label, value in rows.items():
        table.add_row(label, escape(value))
    return table
