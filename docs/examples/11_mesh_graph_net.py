"""A learned step: a small MeshGraphNet on the trajectories of a batch, and its rollout beside the simulation."""

from pathlib import Path
from typing import Any

import h5py
import matplotlib.pyplot as plt
import numpy as np
import torch
from torch import nn

import balloon_warp as bw
from balloon_warp.mesh.topology import quad_sphere

WORLDS = 256
FRAMES = 40
STEPS = 1500
HIDDEN = 48
NOISE = 3.0e-4  # of positions [m]: what is learned must forgive its own errors


class Blocks(nn.Module):
    """A network that passes messages along edges of a mesh, of arrays of shape (worlds, nodes or edges, features)."""

    def __init__(self, node_features: int, edge_features: int, rounds: int = 4):
        super().__init__()
        self.nodes, self.edges = network(node_features), network(edge_features)
        self.edge_rounds = nn.ModuleList(network(3 * HIDDEN) for _ in range(rounds))
        self.node_rounds = nn.ModuleList(network(2 * HIDDEN) for _ in range(rounds))
        self.out = nn.Linear(HIDDEN, 3)

    def forward(self, nodes: torch.Tensor, edges: torch.Tensor, begin: torch.Tensor, end: torch.Tensor) -> torch.Tensor:
        nodes, edges = self.nodes(nodes), self.edges(edges)
        for of_edges, of_nodes in zip(self.edge_rounds, self.node_rounds, strict=True):
            edges = edges + of_edges(torch.cat([edges, nodes[:, begin], nodes[:, end]], -1))
            sums = torch.zeros_like(nodes).index_add_(1, end, edges)
            nodes = nodes + of_nodes(torch.cat([nodes, sums], -1))
        return self.out(nodes)


def network(features: int) -> nn.Module:
    return nn.Sequential(nn.Linear(features, HIDDEN), nn.ReLU(), nn.Linear(HIDDEN, HIDDEN), nn.LayerNorm(HIDDEN))


def read(folder: str) -> torch.Tensor:
    """Positions of all worlds of a split [m], shape (worlds, frames, particles, 3)."""
    files: list[Any] = [h5py.File(path) for path in sorted(Path(folder).glob("*.h5"))]
    return torch.from_numpy(np.stack([file["mesh_pos"][:] for file in files if file.attrs["health"] == 1]))


def see(before: torch.Tensor, now: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """Find what a network sees: speeds and heights of particles, and edges as they are and as they rest."""
    nodes = torch.cat([(now - before) / speed, (now[..., 1:2] / 0.15).clamp(max=2.0)], -1)
    arms = torch.cat([now[:, end] - now[:, begin], (rest[end] - rest[begin]).expand(len(now), -1, -1)], -1)
    lengths = [arms[..., part].norm(dim=-1, keepdim=True) for part in (slice(0, 3), slice(3, 6))]
    return nodes, torch.cat([arms, *lengths], -1) / edge_length


torch.manual_seed(0)
skin = bw.Inflation(pressure=40.0)
ball = bw.Balloon(mesh=quad_sphere(3, 0.15), mass=0.02, position=(0.0, 0.5, 0.0), inflation=skin)
scene = bw.Scene(balloon=[ball], ground=bw.Ground(), frames=FRAMES, touch=False)
draw = np.random.default_rng(0)
ways = draw.uniform([-1.0, -4.0], [1.0, 0.0], (WORLDS, 2))
vary = {f"balloon.0.velocity.{axis}": ways[:, axis] for axis in range(2)}
bw.run_batch(scene, "thrown", WORLDS, vary, trajectories="thrown/data")

tracks, tests = read("thrown/data/train"), read("thrown/data/test")
file: Any = h5py.File(next(Path("thrown/data/train").glob("*.h5")))
rest, edges = torch.from_numpy(file["rest_pos"][:]), torch.from_numpy(file["edges"][:]).long()
begin, end = torch.cat([edges, edges.flip(1)]).T
motion = tracks[:, 1:] - tracks[:, :-1]
speed, kick = motion.std(), (motion[:, 1:] - motion[:, :-1]).std()
edge_length = (rest[end] - rest[begin]).norm(dim=-1).mean()
model = Blocks(4, 8)
optimizer = torch.optim.Adam(model.parameters(), 1.0e-3)
schedule = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, STEPS)
for step in range(STEPS):
    world, frame = torch.randint(len(tracks), (8,)), torch.randint(1, FRAMES, (8,))
    before, now, after = (tracks[world, frame + shift] for shift in (-1, 0, 1))
    now = now + NOISE * torch.randn_like(now)
    loss = (model(*see(before, now), begin, end) - (after - 2.0 * now + before) / kick).square().mean()
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
    schedule.step()
    if step % 500 == 0 or step == STEPS - 1:
        print(f"step {step}: loss {loss.item():.4f}", flush=True)

learned = [tests[:, 0], tests[:, 1]]
with torch.no_grad():
    for _ in range(FRAMES - 1):
        learned.append(2.0 * learned[-1] - learned[-2] + kick * model(*see(*learned[-2:]), begin, end))
rollout = torch.stack(learned, 1)
errors = (rollout - tests).norm(dim=-1).mean((0, 2))
print(f"mean error of {len(tests)} test worlds after {FRAMES} frames: {1e3 * errors[-1]:.1f} mm")
plt.style.use("balloon_warp.studio.charts")
figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4), width_ratios=[2, 1])
for place, frame in enumerate(range(0, FRAMES + 1, max(FRAMES // 5, 1))):
    for points, color in ((tests, "black"), (rollout, "tab:red")):
        x, y, _ = points[0, frame].T
        left.plot((x + 0.45 * place - x.mean())[edges.T], y[edges.T], color=color, linewidth=0.5)
left.set(aspect="equal", title="simulated (black), learned (red)", ylabel="height [m]")
right.plot(1e3 * errors)
right.set(xlabel="frame", ylabel="mean error [mm]")
figure.savefig("mesh_graph_net.png")
