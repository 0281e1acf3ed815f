"""`balloon-warp inspect`"""

import json
from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from balloon_warp.inspection import MeshReport, inspect_mesh
from balloon_warp.mesh.load import load_mesh


def inspect(
    mesh: Annotated[Path, typer.Argument(help="A mesh: OBJ or USD; STL, PLY, OFF, glTF and GLB as triangles.")],
    as_json: Annotated[bool, typer.Option("--json", help="Print the report as JSON on standard output.")] = False,
) -> None:
    """Report a mesh's faces, springs, topology and size, and what is odd about it."""
    report = inspect_mesh(load_mesh(mesh))
    if as_json:
        print(json.dumps(asdict(report)))
        return
    console = Console(highlight=False, soft_wrap=True)
    console.print(_table(mesh.name, report))
    for warning in report.warnings:
        console.print(f"[yellow]warning:[/] {escape(warning)}")


def _table(name: str, report: MeshReport) -> Table:
    table = Table(title=escape(name), title_justify="left", title_style="bold", box=None, show_header=False)
    table.add_column(style="dim")
    table.add_column()
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
    for label, value in rows.items():
        table.add_row(label, value)
    return table
