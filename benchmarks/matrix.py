"""Table of methods by schedule and solver, asked of each.

Run it by python -m balloon_warp.benchmarks.matrix.

The tests hold the table of docs/MATRIX.md to this, and run every method in every schedule.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import warp as wp

from balloon_warp.errors import InputError
from balloon_warp.kernels.laws import Law, Parameter
from balloon_warp.kernels.phase import Phase
from balloon_warp.kernels.substep import conditional_phases
from balloon_warp.laws import face_law, particle_law, spring_law
from balloon_warp.mesh import PolygonMesh
from balloon_warp.mesh.topology import quad_sphere
from balloon_warp.model import Model, build_model
from balloon_warp.scene import Balloon, Body, Inflation, Obstacle, Scene
from balloon_warp.scene.load import override_scene, parse_override
from balloon_warp.schedules import SCHEDULES
from balloon_warp.solvers import PROJECTIVE, solver_named
from balloon_warp.system.warp_setup import quiet_warp


@wp.func
def hold(position: wp.vec3):
    """Pull to the origin, as a law of one's own on particles."""
    return -position


@wp.func
def tighten(stiffness: float):
    """Pull of springs without a rest length, as a law of one's own on springs."""
    return stiffness


@wp.func
def blow(area_vector: wp.vec3):
    """Push outward, as a law of one's own on faces."""
    return area_vector


BALL = quad_sphere(2, 0.5)
PYRAMID = PolygonMesh(
    points=np.array([(0, 0, 0), (1, 0, 0), (1, 0, 1), (0, 0, 1), (0.5, 1, 0.5)], dtype=np.float64),
    face_vertex_counts=np.array([4, 3, 3, 3, 3], dtype=np.int32),
    face_vertex_indices=np.array([0, 1, 2, 3, 1, 0, 4, 2, 1, 4, 3, 2, 4, 0, 3, 4], dtype=np.int32),
)


class Method(NamedTuple):
    """Line of the table."""

    name: str
    overrides: tuple[str, ...] = ()
    """of a scene with nothing but balloons and the paper's step"""
    meshes: tuple[PolygonMesh, ...] = (BALL,)
    """of the balloons"""
    laws: tuple[Law, ...] = ()
    """of one's own"""
    obstacles: tuple[PolygonMesh, ...] = ()
    """in the way"""
    bodies: tuple[PolygonMesh, ...] = ()
    """that move freely"""

    def scene(self) -> Scene:
        """Smallest scene that has the method."""
        balloons = [Balloon(mesh=mesh, inflation=Inflation(k_normal=0.2)) for mesh in self.meshes]
        obstacles = [Obstacle(mesh=mesh, position=(0.0, -9.0, 0.0)) for mesh in self.obstacles]
        bodies = [Body(mesh=mesh, position=(0.0, -9.0, 0.0)) for mesh in self.bodies]
        scene = Scene(balloon=balloons, obstacle=obstacles, body=bodies, normals="cached")
        return override_scene(scene, map(parse_override, self.overrides))

    def model(self) -> Model:
        """Return the model, laid out on the CPU."""
        return build_model(self.scene(), "cpu", laws=self.laws)


GAS = "balloon.inflation={kind='gas', start_pressure=9, added_mass=0, pump=[[0, 0.1], [1, 0]]}"
METHODS = (
    Method("the paper's step"),
    Method("fresh normals", ("normals=fresh",)),
    Method("given pressure", ("balloon.inflation={kind='pressure', pressure=5}",)),
    Method("sealed gas, pumped", (GAS,)),
    Method("gas that breathes undamped", (GAS, "balloon.inflation.breathing_damping=0")),
    Method("air that moves along", (GAS, "balloon.inflation.added_mass=0.5")),
    Method("tubes between balloons", (GAS, "tube=[{balloons=[0, 1], conductance=1e-6}]"), (BALL, BALL)),
    Method("breaths, litres, a pump's curve", ("balloon.inflation={kind='gas', breaths=0.1}",)),
    Method("necks and leaks", (GAS, "balloon.inflation.leak=1e-6", "balloon.neck={}")),
    Method("drag in air, wind", ("balloon.drag_coefficient=0.4", "atmosphere.wind=[1, 0, 0]")),
    Method(
        "gusts, shear, air that thins with height",
        ("balloon.drag_coefficient=0.4", "atmosphere={wind=[1, 0, 0], gusts=0.2, shear=0.1, lapse=0.0065}"),
    ),
    Method("lift and drag by face", ("balloon.face_drag=1",)),
    Method("water", ("water={}",)),
    Method("soft skin full of gas, in water", (GAS, "balloon.inflation.water_evened=0.5", "water={}")),
    Method("viscous springs", ("balloon.stiffness.viscosity=1e-3",)),
    Method("overextended springs stop pulling", ("balloon.stiffness.yield_stretch=2",)),
    Method("torsion springs", ("balloon.stiffness.torsion=0.01",)),
    Method("stiffness that varies", ("balloon.stiffness.variation=0.3",)),
    Method("rubber and film", ("balloon.material={preset='latex'}",)),
    Method("rubber with damping of its own", ("balloon.material={preset='latex', viscosity=10}",)),
    Method("rubber that softens", ("balloon.material={preset='latex', softening=0.3}",)),
    Method(
        "balloons that burst", ("balloon.material={preset='latex', strength=2e7}", "balloon.inflation={pressure=9}")
    ),
    Method("Provot's correction", ("correction=provot",)),
    Method("Tarantino's correction", ("correction=tarantino",)),
    Method("forward Euler", ("solver=forward_euler",)),
    Method("spheres, penalty", ("sphere=[{position=[0, 2, 0]}]", "faces=false")),
    Method("spheres, impulse", ("sphere=[{position=[0, 2, 0]}]", "contact=impulse")),
    Method("spheres that meet spheres", ("sphere=[{position=[0, 2, 0]}, {position=[1, 2, 0]}]",)),
    Method("spheres with friction", ("sphere=[{position=[0, 2, 0], friction=0.5}]", "contact=impulse")),
    Method("spheres that touch faces", ("touch={}", "sphere=[{position=[0, 2, 0], radius=0.01}]")),
    Method("ground", ("ground={}",)),
    Method("obstacles", ("obstacle=[{position=[0, -2, 0]}]",)),
    Method("obstacles that move", ("obstacle=[{position=[0, -2, 0], motion=[[0, [0, 0, 0]], [1, [0, 1, 0]]]}]",)),
    Method("obstacles, meshes", obstacles=(PYRAMID,)),
    Method("free bodies", ("body=[{position=[0, -3, 0]}]",)),
    Method("free bodies, meshes", bodies=(PYRAMID,)),
    Method("strings", ("string=[{anchor=[0, 0, 0]}]",)),
    Method("outer forces on groups of particles", ("force=[{particles=[0, 1], newtons=[0, 1, 0]}]",)),
    Method("fixed particles", ("balloon.fixed=[0]",)),
    Method("faces of any size", meshes=(PYRAMID,)),
    Method("several balloons", ("touch=false",), (BALL, PYRAMID)),
    Method("balloons that touch", ("touch={}",), (BALL, PYRAMID)),
    Method("balloons that touch themselves", ("touch={itself=true}",)),
    Method("a particle law of one's own", laws=(particle_law(hold),)),
    Method("a spring law of one's own", laws=(spring_law(tighten),)),
    Method("a face law of one's own", laws=(face_law(blow),)),
)


def usual_value(row: Parameter) -> float | list[float]:
    """Return a value with which a parameter has an effect: its default, or a value within its domain or bounds."""
    middle = sum(row.domain) / 2.0 if row.domain else row.default or min(max(0.4, row.least), row.most)
    return middle if row.size == 1 else [middle] * row.size


def of_phase(phase: Phase) -> Method:
    """Return the line of a phase that has parameters."""
    sphere = ("sphere=[{position=[0, 2, 0]}]", "faces=false") if any(row.of == "sphere" for row in phase.rows) else ()
    paths = (row.path if row.of == "world" else f"{row.of}.{row.path}" for row in phase.rows)
    said = (f"{path}={usual_value(row)}" for path, row in zip(paths, phase.rows, strict=True))
    return Method(phase.summary.rstrip("."), (*sphere, *said))


METHODS = (*METHODS, *(of_phase(phase) for phase in conditional_phases() if phase.rows))


def simulates(name: str, model: Model) -> bool:
    """Return whether a schedule, or the projective solver, takes a model."""
    try:
        solver_named(name, model)(model)
    except InputError:
        return False
    return True


def as_markdown(methods: Sequence[Method] = METHODS) -> str:
    """Return the table; a method that is itself a solver has no other."""
    lines = [f"| method | {' | '.join(f'`{name}`' for name in (*SCHEDULES, PROJECTIVE))} |"]
    lines.append("|---" * (2 + len(SCHEDULES)) + "|")
    for method in methods:
        model = method.model()
        cells = ["yes" if simulates(name, model) else "no" for name in SCHEDULES]
        implicit = replace(model, scene=model.scene.model_copy(update={"solver": PROJECTIVE}))
        other = "-" if model.scene.solver != Scene.model_fields["solver"].default else None
        cells.append(other or ("yes" if simulates(PROJECTIVE, implicit) else "no"))
        lines.append(f"| {method.name} | {' | '.join(cells)} |")
    return "\n".join(lines)


def main() -> None:
    """Print the table."""
    quiet_warp()
    print(as_markdown())


if __name__ == "__main__":
    main()
