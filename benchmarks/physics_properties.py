"""Properties that hold for any scene: each a function with its formula, tolerance and reason in its docstring.

A property takes a case. It returns the number that it found and the largest that is allowed, or None where it says
nothing about the scene.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from balloon_warp.benchmarks.physics_alike import (
    Measure,
    Property,
    converges,
    is_alike_among_worlds,
    is_alike_in_schedules,
    is_alike_mirrored,
    is_alike_moved,
    is_alike_relisted,
    is_alike_scaled,
    is_alike_turned,
    is_as_in_reference,
    slopes_are_differences,
    worse,
)
from balloon_warp.benchmarks.physics_energy import EPSILON, Energies
from balloon_warp.benchmarks.physics_runs import Case, Run
from balloon_warp.benchmarks.physics_twins import Array
from balloon_warp.kernels.laws.contact import SETTLED
from balloon_warp.lab.statics import Volume
from balloon_warp.mesh.topology import is_closed, mesh_edges

MOST_GROWTH = 1000.0
"""Volume over that at the start that no balloon reaches without a blow-up"""


def stays_finite(case: Case) -> Measure:
    """Numbers stay finite, or a blow-up names a true cause: `found` counts the exceptions.

    A pressure that alone blows a balloon up, or a limit point, does so with four times the substeps, too. Where more
    substeps help, four times as many do, or 16 times.
    """
    blow_up = case.run.blow_up
    if blow_up is None:
        wild = sum(int((~np.isfinite(state)).sum()) for state in case.run.states.values())
        return Measure(wild, 0, "numbers that are not finite")
    finer = case.finer(4).blow_up
    if blow_up.limit_point or blow_up.pressure or blow_up.k_normal:
        return Measure(finer is None, 0, f"{blow_up}, but not with four times the substeps")
    still = finer is not None and case.finer(16).blow_up is not None
    return Measure(still, 0, f"{blow_up}, but 16 times the substeps blow up, too")


def keeps_volume(case: Case) -> Measure | None:
    """Keep the volume of a gas balloon positive, and below a thousandfold: 0 < V / V0 < 1000.

    Its pressure grows without bound in a small volume, and nothing draws it to a large one. A given pressure bears no
    collapse, and past its limit point swells a balloon without end, as LIMITS.md says. A volume may be below zero by
    the volume that the blur of a mesh may fold, a hundredth of that at the start.
    """
    found, model = None, case.run.model
    if case.run.blow_up or model.bursts:
        return None
    for number, shape in enumerate(model.shapes):
        if case.scene.balloon[number].inflation.kind == "gas" and is_closed(mesh_edges(shape.skin)):
            volumes = volumes_of(case.run, number) / volumes_of(case.run, number)[0]
            off = max(volumes.max() / MOST_GROWTH - 1.0, -volumes.min())
            found = worse(
                found, Measure(float(off), 0.01, "volume over that at the start, below zero or beyond a thousand")
            )
    return found


def gains_no_energy(case: Case) -> Measure | None:
    """Energy never exceeds that at the start: H = T + V + (h/2) v . F.

    H is the quantity that symplectic Euler keeps of a linear oscillator; T + V alone swings by h w / 2. Of others it is
    off by (h w)^2 / 4 of that in motion; contact acts between two substeps, and is off by h w / 2. At four times the
    substeps of `auto` h w is at most 0.4.
    """
    if not Energies.knows(case.scene):
        return None
    run = case.finer(4)
    if run.blow_up:
        return None
    energies = Energies(run)
    total = energies.total()
    smooth = energies.is_smooth
    return Measure(float((total - total[0]).max()), (0.04 if smooth else 0.2) * energies.scale() + energies.rounding())


def keeps_momentum(case: Case) -> Measure | None:
    """Momentum balance: P(t) - P(0) = M g t.

    Each substep rounds each velocity by half an epsilon of itself, to either side; after n substeps that is sqrt(n) of
    it, times a few as of any sum of random signs.
    """
    if not acts_inside(case):
        return None
    energies = Energies(case.run)
    found = energies.momenta() - energies.momenta()[0] - energies.weight_impulses()
    return Measure(float(np.linalg.norm(found, axis=1).max()), 4.0 * energies.momentum_rounding())


def keeps_angular_momentum(case: Case) -> Measure | None:
    """Angular momentum about the center of mass stays: sum m (x - c) x (v - V) + R J R^T w.

    Rounding as of momentum, times the distance from the center. A gas's weight acts at the center of its volume, and so
    has a torque.
    """
    if not acts_inside(case) or (case.scene.gravity and any(b.inflation.kind == "gas" for b in case.scene.balloon)):
        return None
    energies = Energies(case.run)
    found = energies.angular_momenta()
    allowed = 4.0 * energies.momentum_rounding() * energies.reach()
    return Measure(float(np.linalg.norm(found - found[0], axis=1).max()), allowed)


def keeps_gas(case: Case) -> Measure | None:
    """Gas is neither made nor lost without pump, leak, tube or tear: n(t) = n(0)."""
    scene = case.scene
    gas = [number for number, balloon in enumerate(scene.balloon) if balloon.inflation.kind == "gas"]
    if not gas or scene.tube or case.run.model.bursts or any(scene.balloon[number].inflation.pump for number in gas):
        return None
    amounts = case.run.states["gas_amounts"][:, gas]
    return Measure(float(np.abs(amounts / amounts[0] - 1.0).max()), 0.0)


def follows_boyle(case: Case) -> Measure | None:
    """Keep p V^gamma of a sealed gas at the end of each substep, to first order in the change of volume.

    Without contact the last substep began at x - h v, so that P = p(V') + p'(V') h dV/dx . v is known there; the rest
    is rounding, of the volume by sums over faces, and of places.
    """
    if keeps_gas(case) is None or not Energies(case.run).is_smooth or case.scene.atmosphere.density:
        return None
    worst, run = None, case.run
    for number, balloon in enumerate(case.scene.balloon):
        begin, end = run.model.particle_offsets[number : number + 2]
        points, velocities = (run.states[name][1:, begin:end] for name in ("points", "velocities"))
        volume, step = Volume(run.model.shapes[number].skin), run.model.step_seconds
        air, gamma = case.scene.atmosphere.pressure, balloon.inflation.gamma
        before = points - step * velocities
        volumes = np.array([volume.of(places) for places in before])
        growth = np.array(
            [(volume.slopes(there) * by).sum() for there, by in zip(before, step * velocities, strict=True)]
        )
        pressures = (air + balloon.inflation.start_pressure) * (volumes_of(run, number)[0] / volumes) ** gamma
        expected = pressures * (1.0 - gamma * growth / volumes)
        extent = np.abs(points).max() / case.size
        allowed = pressures * 64.0 * EPSILON * extent + 1e-4 * np.abs(expected - air)
        ratio = np.abs(run.states["pressures"][1:, number] + air - expected) / allowed
        worst = worse(worst, Measure(float(ratio.max()), 1.0, f"pressure of balloon {number} over its tolerance"))
    return worst


def stays_outside(case: Case) -> Measure | None:
    """No particle is in the ground or an obstacle, by more than rounding of places [m]: x . up >= height, d(x) >= 0.

    Between two of them it is pushed to and fro until it moves by less than a thousandth of its way in the step.
    """
    scene, model = case.scene, case.run.model
    places, deepest = case.run.states["points"], -np.inf
    if scene.ground:
        deepest = scene.ground.height - (places @ np.array(scene.up)).min()
    for number, obstacle in enumerate(model.obstacles):
        for frame, points in enumerate(places):
            pose = obstacle_pose(case, number, frame)
            deepest = max(deepest, depth_in(obstacle.kind, obstacle.size, np.array(scene.up), pose, points))
    if not np.isfinite(deepest):
        return None
    farthest = max([0.0, *(np.abs(each.position).max() + max(each.size) for each in scene.obstacle)])
    way = model.step_seconds * np.linalg.norm(case.run.states["velocities"], axis=2).max()
    settled = float(SETTLED) * way if len(model.obstacles) + bool(scene.ground) > 1 else 0.0
    rounding = 16.0 * EPSILON * (np.abs(places).max() + farthest)
    return Measure(float(deepest), float(rounding + settled), "depth [m]")


def repeats(case: Case) -> Measure:
    """Give the same bits again, as GUARANTEES.md says of all schedules but `scatter`."""
    return Measure(float(np.abs(case.again().points - case.run.points).max()), 0.0)


def tells_contact_forces(case: Case) -> Measure | None:
    """Contact forces of the ground, obstacles, spheres and bodies account for the motion: F = dP/dt + M g.

    At rest they sum to the weight. F is the mean over a frame, P the momentum of the balloons, moved by
    nothing else. Rounding is that of momentum in each substep.
    """
    scene = case.scene
    met = scene.ground or scene.sphere or scene.obstacle or scene.body
    others = Energies.knows(scene) and case.run.blow_up is None and not case.run.model.bursts
    if not met or not others or any(not is_closed(mesh_edges(shape.skin)) for shape in case.run.model.shapes):
        return None
    run = case.simulate(case.with_substeps(1).model_copy(update={"contacts": True}), case.device)
    if run.blow_up:
        return None
    energies = Energies(run)
    balloons = run.states["velocities"].transpose(0, 2, 1) @ energies.masses
    weight = scene.gravity * energies.masses.sum() * energies.up
    forces = run.states["contact_forces"][1:].sum(axis=(1, 2))
    found = forces - weight - np.diff(balloons, axis=0) / run.model.frame_seconds
    allowed = 8.0 * energies.momentum_rounding() / run.model.frame_seconds + 1e-5 * np.abs(forces).max()
    return Measure(float(np.linalg.norm(found, axis=1).max()), float(allowed), "force [N] that no contact tells")


def acts_inside(case: Case) -> bool:
    """Return whether nothing outside acts on the things of a scene but their weight."""
    scene = case.scene
    fixed = scene.obstacle or scene.string or scene.ground or scene.water or any(b.fixed for b in scene.balloon)
    fixed = fixed or any(balloon.inflation.kind == "normal_force" for balloon in scene.balloon)
    air = scene.atmosphere.density != 0.0 or any(balloon.damping for balloon in scene.balloon)
    opened = any(not is_closed(mesh_edges(shape.skin)) for shape in case.run.model.shapes)
    return not (fixed or air or scene.change or opened or case.run.blow_up or case.run.model.bursts)


def volumes_of(run: Run, number: int) -> Array:
    """Return the volumes of a balloon [m^3], shape (frames + 1,)."""
    begin, end = run.model.particle_offsets[number : number + 2]
    volume = Volume(run.model.shapes[number].skin)
    return np.array([volume.of(points) for points in run.states["points"][:, begin:end]])


def obstacle_pose(case: Case, number: int, frame: int) -> tuple[Array, Array]:
    """Return the place and the rotation matrix of an obstacle, by its keyframes."""
    obstacle, time = case.scene.obstacle[number], frame * case.run.model.frame_seconds
    place, turn = np.array(obstacle.position), Rotation.from_euler("xyz", obstacle.rotation, degrees=True)
    if obstacle.motion:
        keys = np.array([[key[0], *key[1], *(key[2] if len(key) > 2 else (0.0,) * 3)] for key in obstacle.motion])
        now = np.array([np.interp(time, keys[:, 0], column) for column in keys[:, 1:].T])
        place, turn = place + now[:3], Rotation.from_euler("xyz", now[3:], degrees=True) * turn
    return place, turn.as_matrix()


def depth_in(kind: str, size: Array, up: Array, pose: tuple[Array, Array], points: Array) -> float:
    """Return the largest depth of points in a box or capsule [m]; negative outside.

    Args:
        size: half edges of a box; radius and half length of a capsule, which stands along the up axis.
    """
    own = (points - pose[0]) @ pose[1]
    if kind == "box":
        return float((np.array(size) - np.abs(own)).min(axis=1).max())
    along = np.clip(own @ up, -size[1], size[1])
    return float((size[0] - np.linalg.norm(own - along[:, None] * up, axis=1)).max())


PROPERTIES: tuple[Property, ...] = (
    stays_finite, keeps_volume, gains_no_energy, keeps_momentum, keeps_angular_momentum, keeps_gas, follows_boyle,
    stays_outside, tells_contact_forces, repeats, is_alike_in_schedules, is_alike_among_worlds, is_alike_turned,
    is_alike_mirrored, is_alike_moved, is_alike_scaled, is_alike_relisted, is_as_in_reference, converges,
    slopes_are_differences,
)  # fmt: skip
