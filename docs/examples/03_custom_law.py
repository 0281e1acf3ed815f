"""A law of one's own: a whirlwind that carries a balloon around.

The law is a function of Warp. It runs in every schedule and in batches, as fast as the laws of the package.
"""

import warp as wp
from matplotlib import pyplot as plt

import balloon_warp as bw

FRAMES = 240


@wp.func
def whirl(position: wp.vec3, velocity: wp.vec3, mass: float, grip: float, turn: float):
    around = wp.vec3(turn * position[2], 0.0, -turn * position[0])  # velocity of the air, about the y axis
    return mass * grip * (around - velocity)  # [N]


law = bw.particle_law(
    whirl,
    [
        bw.Parameter("grip", "1/s", default=0.0, least=0.0, meaning="how fast a particle takes the air's velocity"),
        bw.Parameter("turn", "rad/s", default=3.0),
    ],
    neutral={"grip": 0.0},
    drag=lambda mass, grip: mass * grip,  # [N s/m]: the stable step allows for it
)

overrides = {"frames": FRAMES, "balloon.position": (1.0, 0.5, 0.0), "balloon.law.whirl.grip": 4.0, "gravity": 0.0}
scene = bw.load_scene("squirrel_inflate", {**overrides, "balloon.helium": 0.0, "balloon.damping": 0.0})
moved = bw.simulate(scene, laws=[law])
path = moved.points[0].mean(axis=1)  # of the center, shape (FRAMES + 1, 3) [m]

plt.style.use("balloon_warp.studio.charts")
plt.figure(figsize=(4.8, 4.8))
plt.plot(path[:, 0], path[:, 2])
plt.plot(path[0, 0], path[0, 2], "o", color="C0")
plt.xlabel("x [m]")
plt.ylabel("z [m]")
plt.axis("equal")
plt.savefig("custom_law.png")
