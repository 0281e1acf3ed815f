"""The state as an array of NumPy, PyTorch or JAX, without a copy.

Values written into the array are simulated next. On a GPU take PyTorch or JAX; NumPy's view is for the CPU.
"""

import importlib.util

import numpy as np
import warp as wp

import balloon_warp as bw

simulator = bw.Simulator(bw.load_scene("squirrel_inflate"), device="cpu", schedule="gather")
simulator.step()


def center() -> np.ndarray:
    """Return the balloon's center [m]."""
    return simulator.read_frame().points[0].mean(axis=0)


velocities = simulator.state.velocities.numpy()  # shape (worlds, particles, 3) [m/s]; the same memory
velocities[0, :, 1] += 2.0  # a kick upward
before = center()
simulator.step()
risen = float((center() - before)[1])
print(f"NumPy: risen by {risen:.3f} m in a frame")

if importlib.util.find_spec("torch"):
    # An array is asked for anew after each step: a schedule may keep two, and take them in turns.
    points = wp.to_torch(simulator.state.points)
    assert points.data_ptr() == simulator.state.points.ptr
    points[..., 1] += 1.0  # all of it a meter higher
    print("PyTorch:", tuple(points.shape), points.dtype)

if importlib.util.find_spec("jax"):
    shared = wp.to_jax(simulator.state.points)
    print("JAX:", shared.shape, shared.dtype)
