"""Simulations beside formulas: curves, and how far apart they are.

Run `python -m balloon_warp.benchmarks.validation docs` to renew the numbers and pictures of docs/VALIDATION.md.
"""

import json
import re
import sys
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from balloon_warp.batch.trajectories import simulate
from balloon_warp.mesh.topology import quad_sphere, signed_volume, total_area
from balloon_warp.scene import Atmosphere, Balloon, Change, Inflation, Material, Scene, Stiffness

RADIUS, THICKNESS = 0.05, 2e-4  # [m]
MU, RATIO, LIMIT = 4.0e5, 0.1, 97.2
OGDEN = (6.3e5, 1.2e3, -1.0e4), (1.3, 5.0, -2.0)


@dataclass(frozen=True)
class Curve:
    """Simulated curve, and a formula's."""

    name: str
    x: list[float]
    simulated: list[float]
    expected: list[float]

    @property
    def error(self) -> float:
        """Largest difference, over the largest value."""
        simulated, expected = np.array(self.simulated), np.array(self.expected)
        return float(np.abs(simulated - expected).max() / np.abs(expected).max())


@dataclass(frozen=True)
class Case:
    """Curves of one kind."""

    title: str
    x_label: str
    y_label: str
    formula: str
    curves: list[Curve]
    logarithmic: bool = False


def curve(name: str, x: Any, simulated: Any, expected: Any) -> Curve:
    rows = (np.asarray(each, dtype=np.float64).tolist() for each in (x, simulated, expected))
    return Curve(name, *rows)


def slope_of_energy(kind: str, stretch: NDArray[np.float64]) -> NDArray[np.float64]:
    """dW / d lambda of rubber that is stretched alike both ways [Pa]."""
    first, second = 4.0 * (stretch - stretch**-5.0), 4.0 * (stretch**3.0 - stretch**-3.0)  # of I1 and I2
    if kind == "ogden":
        terms = zip(*OGDEN, strict=True)
        return np.sum([2.0 * mu * (stretch ** (a - 1.0) - stretch ** (-2.0 * a - 1.0)) for mu, a in terms], axis=0)
    if kind == "gent":
        invariant = 2.0 * stretch**2.0 + stretch**-4.0
        return 0.5 * MU * first / (1.0 - (invariant - 3.0) / LIMIT)
    ratio = RATIO if kind == "mooney_rivlin" else 0.0
    return 0.5 * MU / (1.0 + ratio) * (first + ratio * second)


def rubber() -> Case:
    """Balls of rubber are pumped up slowly: their pressure by their stretch."""
    ball = quad_sphere(5, RADIUS)
    materials = {
        "neo_hookean": {"shear_modulus": MU},
        "mooney_rivlin": {"shear_modulus": MU, "mooney_ratio": RATIO},
        "gent": {"shear_modulus": MU, "gent_limit": LIMIT},
        "ogden": {"ogden_moduli": OGDEN[0], "ogden_exponents": OGDEN[1]},
    }
    pump = [(0.0, 0.02), (0.4, 0.02), (1.0, 1.0), (2.0, 2.4)]
    curves = []
    for kind, numbers in materials.items():
        material = Material.model_validate({"kind": kind, "thickness": THICKNESS, "density": 940.0, **numbers})
        inflation = Inflation(kind="gas", start_pressure=0.0, pump=pump)
        balloon = Balloon(mesh=ball, material=material, damping=0.1, inflation=inflation)
        moved = simulate(Scene(balloon=[balloon], gravity=0.0, frames=120), device="cpu", every=2)
        stretch = np.cbrt(moved.volumes[1:, 0] / signed_volume(ball))
        lever = THICKNESS * total_area(ball) / (3.0 * signed_volume(ball))  # h / R of a sphere
        expected = lever * slope_of_energy(kind, stretch) / stretch**2
        curves.append(curve(kind, stretch, moved.pressures[1:, 0], expected))
    return Case("Rubber balls, pumped up", "stretch", "pressure [Pa]", "p = (h / R) W'(λ) / λ²", curves)


def gas() -> Case:
    """Simulate balloons of sealed gas that grow as the air's pressure falls in steps."""
    inflation = [Inflation(kind="gas", start_pressure=0.0, gamma=gamma) for gamma in (1.0, 1.4, 1.667)]
    steps = [Change(time=0.1 * number, set={"atmosphere.pressure": 101325.0 * 0.85**number}) for number in range(1, 10)]
    curves = []
    for each in inflation:
        ball = quad_sphere(4, 0.5)
        soft = Stiffness(structural=5.0, shear=2.0, flexion=1.0)
        balloon = Balloon(mesh=ball, mass=0.5, damping=5.0, stiffness=soft, inflation=each)
        moved = simulate(Scene(balloon=[balloon], gravity=0.0, frames=60, change=steps), device="cpu")
        volumes = moved.volumes[5::6, 0]  # before each change, at rest
        air = 101325.0 * 0.85 ** np.arange(len(volumes))
        expected = 101325.0 * (signed_volume(ball) / volumes) ** each.gamma
        curves.append(curve(f"gamma = {each.gamma:g}", volumes, moved.pressures[5::6, 0] + air, expected))
    return Case(
        "Sealed gas that expands", "volume [m³]", "pressure in full [Pa]", "p V^gamma = p₀ V₀^gamma", curves, True
    )


def drag() -> Case:
    """Balls fall through air."""
    radius, density, coefficient = 0.15, 1.2, 0.47
    curves = []
    for mass in (0.02, 0.1, 0.5):
        still = Inflation(kind="pressure", pressure=0.0)
        hard = Stiffness(structural=2000.0 * mass, shear=1000.0 * mass, flexion=200.0 * mass)
        ball = Balloon(
            mesh=quad_sphere(9, radius), mass=mass, stiffness=hard, inflation=still, damping=0.0,
            drag_coefficient=coefficient,
        )  # fmt: skip
        scene = Scene(balloon=[ball], atmosphere=Atmosphere(density=density), frames=90)
        moved = simulate(scene, device="cpu", every=3)
        terminal = np.sqrt(2.0 * mass * 9.81 / (density * coefficient * np.pi * radius**2))
        fallen = -moved.velocities[0][:, :, 1].mean(axis=1)
        expected = terminal * np.tanh(9.81 * moved.times / terminal)
        curves.append(curve(f"{mass * 1000:g} g", moved.times, fallen, expected))
    return Case("Balls that fall through air", "time [s]", "speed [m/s]", "v = v∞ tanh(g t / v∞)", curves)


def convergence() -> Case:
    """Simulate a ball of springs that swings under a sudden pressure: half the step, half the error."""

    def points(substeps: int) -> NDArray[np.float32]:
        balloon = Balloon(mesh=quad_sphere(4, 0.5), mass=1.0, damping=0.0, inflation=Inflation(pressure=50.0))
        scene = Scene(balloon=[balloon], gravity=0.0, substeps=substeps, frames=12)
        return simulate(scene, device="cpu").points[0][-1]

    counts = np.array([16, 32, 64, 128, 256])
    finest = points(4096)
    errors = np.array([np.sqrt(np.square(points(int(count)) - finest).sum(axis=1).mean()) for count in counts])
    line = errors[-1] * counts[-1] / counts
    title = "The error of a step, against the finest"
    swing = [curve("a ball that swings", counts, errors, line)]
    return Case(title, "substeps a frame", "error [m]", "error ~ h", swing, True)


CASES: dict[str, Callable[[], Case]] = {each.__name__: each for each in (rubber, gas, drag, convergence)}


def table(cases: dict[str, Any]) -> str:
    """Rows of Markdown, of the JSON's cases."""
    rows = ["| what | formula | | largest difference |", "|---|---|---|---|"]
    for case in cases.values():
        for each in case["curves"]:
            error = Curve(**each).error
            rows.append(f"| {case['title']} | {case['formula']} | {each['name']} | {100.0 * error:.2f} % |")
    return "\n".join(rows)


def main(folder: Path) -> None:
    """Write the JSON, the page's table and the pictures."""
    from balloon_warp.benchmarks.validation_pictures import draw  # needs Matplotlib

    cases = {name: asdict(case()) for name, case in CASES.items()}
    (folder / "validation.json").write_text(json.dumps(cases, indent=1) + "\n", encoding="utf-8")
    for name, case in cases.items():
        draw(case, folder / "pictures" / f"validation_{name}.svg")
    page = folder / "VALIDATION.md"
    before, after = re.split(
        r"(?<=<!-- table -->).*(?=<!-- end -->)", page.read_text(encoding="utf-8"), flags=re.DOTALL
    )
    page.write_text(f"{before}\n\n{table(cases)}\n\n{after}", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1] if len(sys.argv) > 1 else "docs"))
