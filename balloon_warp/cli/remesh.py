"""The command `balloon-warp remesh`."""

from pathlib import Path
from typing import Annotated

import typer

from balloon_warp.cli.options import PartsOption, PrimOption, UpOption, checked_parts, checked_up
from balloon_warp.cli.progress import note, stages, warn
from balloon_warp.errors import InputError
from balloon_warp.files import check_writable, is_same_file
from balloon_warp.mesh.load import Treatment, in_y_up_meters, load_mesh, prepared
from balloon_warp.mesh.obj import LOADERS, check_materials, write_obj
from balloon_warp.mesh.polygon_mesh import as_told
from balloon_warp.mesh.thickness import standing, up_said
from balloon_warp.warp_logging import quiet_warp


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
        surface = as_told(surface, None, axis)
        if taken := checked_parts(parts):
            surface = prepared(surface, mesh, Treatment(taken=taken))
        if surface.looks is not None:
            check_materials(output)
        quiet_warp()
        from balloon_warp.mesh.remesh import remesh as remeshed  # loads Warp: only once there is a mesh

        quads = in_y_up_meters(remeshed(surface, cells, on_stage=stage))
        stage("writing it")
        write_obj(output, quads)
    if why or surface.up_axis == "Z":
        note(f"{mesh.name}: {up_said(surface, said is not None, why)}")
    for warning in quads.warnings:
        warn(warning)
    print(f"wrote {output}: {quads.vertex_count:,} vertices, {quads.face_count:,} quads")
