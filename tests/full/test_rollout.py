"""Scene as a PyTorch function: its derivatives are those of `gradient`, with a policy in the loop, too."""

import numpy as np
import pytest
from gradient_scenes import CASES, scene

import balloon_warp as bw

torch = pytest.importorskip("torch")
PATHS = ["balloon.velocity.1", "balloon.mass", "balloon.0.inflation.pump.1.1"]
VALUES = np.array([[-1.0, 0.05, -5.0], [0.5, 0.06, 3.0]])
PUMPED = {"pump": [[0.0, 20.0], [0.04, -5.0]]}


def pumped() -> bw.Scene:
    return scene("gas", frames=3, springs={"structural": 1500.0}, gas=PUMPED)


def test_it_has_the_frames_and_derivatives_of_gradient(device: str):
    weights = np.random.default_rng(2).normal(size=(4, 26, 3))

    def loss(moved: bw.Trajectories):
        slopes = np.broadcast_to(weights, moved.points[0].shape)
        pressures = np.full(moved.pressures.shape, 1e-3)
        value = (weights * moved.points[0]).sum(axis=(1, 2, 3)) + 1e-3 * moved.pressures.sum(axis=(1, 2))
        return value, {"points": [slopes], "pressures": pressures}

    vary = dict(zip(PATHS, VALUES.T, strict=True))
    told = bw.gradient(pumped(), of=PATHS, loss=loss, world_count=2, vary=vary, device=device)
    values = torch.tensor(VALUES, requires_grad=True)
    moved = bw.Rollout(pumped(), of=PATHS, world_count=2, device=device)(values)
    np.testing.assert_array_equal(moved.points.detach().cpu().numpy(), told.trajectories.points[0])
    each = (moved.points * torch.tensor(weights).to(moved.points)).sum(dim=(1, 2, 3))
    (each + 1e-3 * moved.pressures.sum(dim=(1, 2))).sum().backward()
    for column, path in enumerate(PATHS):
        np.testing.assert_allclose(values.grad[:, column], told.gradients[path], rtol=1e-5)


def test_a_policy_learns_within_the_loop(device: str):
    rollout = bw.Rollout(pumped(), of=["balloon.0.inflation.pump.0.1"], device=device)

    def height(gain: float) -> "torch.Tensor":
        weight = torch.tensor([[gain]], dtype=torch.float64, requires_grad=True)
        begun = rollout.start(torch.tensor([[20.0]], dtype=torch.float64))
        for _ in range(2):
            begun = rollout.step(begun, weight * begun.points[..., 1].mean(dim=1, keepdim=True).cpu().double())
        return weight, (begun.points**2).sum()

    weight, end = height(20.0)
    end.backward()
    more, less = (height(20.0 + sign * 2.0)[1].item() for sign in (1.0, -1.0))
    assert weight.grad.item() == pytest.approx((more - less) / 4.0, rel=0.01)
    with pytest.raises(RuntimeError, match="second time"):
        end.backward()


def test_values_of_another_shape_are_refused():
    rollout = bw.Rollout(pumped(), of=PATHS, device="cpu")
    with pytest.raises(bw.InputError, match=r"expected values of shape \(1, 3\), worlds and paths"):
        rollout(torch.zeros(3))


@pytest.mark.parametrize(
    ("case", "path", "seen", "gain"),
    [("gas beside spheres", "sphere.0.mass", "sphere_positions", 0.2), ("touch", "balloon.1.mass", "points", 0.08)],
)
def test_a_policy_that_sees_spheres_and_contacts_learns_within_the_loop(case: str, path: str, seen: str, gain, device):
    """The derivative by a policy's weight, mass over height, agrees with differences, to 1%: states are float32."""
    of = CASES[case].scene
    rollout = bw.Rollout(of, of=[path], device=device)

    def end(gain: float) -> tuple["torch.Tensor", "torch.Tensor"]:
        weight = torch.tensor([[gain]], dtype=torch.float64, requires_grad=True)
        begun = rollout.start(weight.detach())
        for _ in range(of.frames):
            height = getattr(begun, seen)[..., 1].mean(dim=1, keepdim=True).cpu().double()
            begun = rollout.step(begun, weight * height)
        return weight, (begun.points.double() ** 2).sum() + (begun.sphere_velocities.double() ** 2).sum()

    weight, told = end(gain)
    told.backward()
    more, less = (end(gain * (1.0 + sign * 1e-3))[1].item() for sign in (1.0, -1.0))
    assert weight.grad.item() == pytest.approx((more - less) / (2e-3 * gain), rel=0.01)
