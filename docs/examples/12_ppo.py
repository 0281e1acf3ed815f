"""A policy that PPO learns on the device, for any task of `balloon_warp.learn`: its curve and its return.

    python 12_ppo.py Inflate --minutes 3
    python 12_ppo.py Juggle --minutes 5

The step that resets a world after its end is not learned from; where time was up, what is seen last is worth something.
"""

import argparse
from collections.abc import Callable
from importlib.util import find_spec
from time import perf_counter

import numpy as np
import torch
from torch import Tensor, nn

from balloon_warp.learn import make_vec

GAMMA, LAMBDA, CLIP, KL, EPOCHS, MINIBATCHES, PARTS = 0.99, 0.95, 0.2, 0.01, 5, 8, 8

torch.distributions.Distribution.set_default_validate_args(False)  # which would wait for the device
parser = argparse.ArgumentParser(description="Learn a task by PPO.")
parser.add_argument("task", help="Altitude, Inflate, Juggle, Press or Target")
parser.add_argument("--device", help="cpu or cuda:0; the GPU if missing")
for name, value in {"envs": 2048, "steps": 64, "minutes": 5.0, "updates": 100_000, "seed": 0}.items():
    parser.add_argument(f"--{name}", type=type(value), default=value, help=f"{value} if missing")
given = parser.parse_args()


class Scale(nn.Module):
    """Mean and variance of all rows so far, by which others are scaled."""

    def __init__(self, size: int):
        super().__init__()
        self.register_buffer("moments", torch.stack([torch.zeros(size), torch.ones(size)]))
        self.count = 0

    def take(self, rows: Tensor) -> None:
        (mean, variance), self.count = self.moments, self.count + len(rows)
        off, share = rows.mean(0) - mean, len(rows) / self.count
        variance += share * (rows.var(0, correction=0) - variance + (1.0 - share) * off.square())
        mean += share * off

    def forward(self, rows: Tensor) -> Tensor:
        return ((rows - self.moments[0]) / (self.moments[1] + 1.0e-8).sqrt()).clamp(-10.0, 10.0)


class Policy(nn.Module):
    """Distribution of actions, and the value of what is seen."""

    def __init__(self, seen: int, actions: int):
        super().__init__()
        self.scale, self.actor, self.critic = Scale(seen), network(seen, actions), network(seen, 1)
        self.log_deviation = nn.Parameter(torch.full((actions,), -0.5))

    def forward(self, seen: Tensor) -> tuple[torch.distributions.Normal, Tensor]:
        seen = self.scale(seen)
        return torch.distributions.Normal(self.actor(seen), self.log_deviation.exp()), self.critic(seen).squeeze(-1)


def network(inputs: int, outputs: int) -> nn.Module:
    last = nn.Linear(128, outputs)
    nn.init.orthogonal_(last.weight, 0.01)
    return nn.Sequential(nn.Linear(inputs, 128), nn.ELU(), nn.Linear(128, 128), nn.ELU(), last)


def mean_return(act: Callable[[Tensor], Tensor]) -> float:
    """Mean return of the first episodes of all worlds, the same ones for each policy."""
    seen, _ = env.reset(seed=given.seed + 1)
    total, goes_on = torch.zeros(given.envs, device=device), torch.ones(given.envs, device=device)
    for _ in range(env.task.most_steps):
        seen, reward, terminated, truncated, _ = env.step(act(seen))
        total += reward * goes_on
        goes_on *= ~(terminated | truncated)
    return total.mean().item()


torch.manual_seed(given.seed)
env = make_vec(given.task, given.envs, device=given.device, output="torch")
device = env.reset(seed=given.seed)[0].device
drawn = torch.empty(given.envs, env.task.actions, device=device)
returns = {"random": mean_return(lambda seen: drawn.uniform_(-1.0, 1.0))}
returns["scripted"] = mean_return(lambda seen: torch.from_numpy(env.task.policy(seen.cpu().numpy())).to(seen))
print(f"{given.task}, {given.envs} worlds on {device}: {returns}", flush=True)
policy = Policy(env.task.observations, env.task.actions).to(device)
optimizer = torch.optim.Adam(policy.parameters(), 3.0e-4, eps=1.0e-5)
seen, _ = env.reset(seed=given.seed)
part, over = torch.arange(given.envs, device=device) % PARTS, torch.zeros(given.envs, device=device, dtype=torch.bool)
for number in range(PARTS):  # begin parts one after the other, else an update would see now beginnings and now ends
    for _ in range(env.task.most_steps // PARTS):
        seen, _, terminated, truncated, _ = env.step(drawn.uniform_(-1.0, 1.0))
        over = terminated | truncated
        policy.scale.take(seen)
    over = over & (part != number)
    seen, _ = env.reset(options={"reset_mask": (part == number).int()})
total, gain = torch.zeros(2, given.envs, device=device)
whole, change, gains, curve, begin = over, total, Scale(1).to(device), [], perf_counter()
while len(curve) < given.updates and perf_counter() - begin < 60.0 * given.minutes:
    rows = []
    for _ in range(given.steps):
        was, begun, action = seen, over, policy(seen)[0].sample()
        seen, reward, terminated, truncated, _ = env.step(action)
        over, total, gain = terminated | truncated, total + reward, GAMMA * gain + reward
        rows.append((was, action, reward, terminated, over, begun, gain, total, whole))
        total, gain, whole = total * ~over, gain * ~over, whole | over  # what began before us is not counted
    was, did, rewards, lost, ends, resets, sums, totals, counted = map(torch.stack, zip(*rows, strict=True))
    gains.take(sums.reshape(-1, 1))
    with torch.no_grad():
        (chance, values), following = policy(was), policy(seen)[1]
        logs = chance.log_prob(did).sum(-1)
    ahead, advantages = torch.zeros_like(total), torch.zeros_like(rewards)
    for step in reversed(range(given.steps)):
        error = rewards[step] / (gains.moments[1] + 1.0e-8).sqrt() + GAMMA * following * ~lost[step] - values[step]
        ahead = advantages[step] = error + GAMMA * LAMBDA * ahead * ~ends[step]
        following = values[step]
    kept = [row[~resets] for row in (was, did, logs, advantages, values + advantages)]
    orders = [torch.randperm(len(kept[0]), device=device) for _ in range(EPOCHS)]
    for chosen in (part for order in orders for part in order.chunk(MINIBATCHES)):
        points, taken, log, advantage, worth = (row[chosen] for row in kept)
        chance, value = policy(points)
        change = chance.log_prob(taken).sum(-1) - log
        advantage = (advantage - advantage.mean()) / (advantage.std(correction=0) + 1.0e-8)
        gained = torch.min(change.exp() * advantage, change.exp().clamp(1.0 - CLIP, 1.0 + CLIP) * advantage)
        optimizer.zero_grad()
        ((value - worth).square().mean() - gained.mean()).backward()
        nn.utils.clip_grad_norm_(policy.parameters(), 1.0)
        optimizer.step()
    far = (change.exp() - 1.0 - change).mean().item() / KL  # by its divergence, which the learning rate holds near KL
    rate = optimizer.param_groups[0]["lr"] * (1.5 if far < 0.5 else 1.0 if far < 2.0 else 1.0 / 1.5)
    optimizer.param_groups[0]["lr"] = min(max(rate, 1.0e-5), 3.0e-3)
    policy.scale.take(was.flatten(0, 1))
    earned, number = totals[ends & counted], len(curve) + 1
    curve.append((perf_counter() - begin, number * rewards.numel(), len(earned), earned.mean().item()))
    if len(curve) % 10 == 1:
        print("{:.0f} s, {} steps, {} episodes: return {:.2f}".format(*curve[-1]), flush=True)

returns["learned"] = mean_return(lambda seen: policy(seen)[0].mean.detach())
print(", ".join(f"{name} {value:.1f}" for name, value in returns.items()), f"in {curve[-1][0] / 60.0:.1f} minutes")
np.savetxt(f"ppo_{given.task}.csv", curve, "%.9g", ",", header="seconds,steps,episodes,return", comments="")
if find_spec("matplotlib"):
    import matplotlib.pyplot as plt

    plt.style.use("balloon_warp.studio.charts")
    figure, axes = plt.subplots(figsize=(6, 4))
    axes.plot([row[0] / 60.0 for row in curve], [row[3] for row in curve], label="while learning")
    for name, style in (("learned", "-"), ("scripted", "--"), ("random", ":")):
        axes.axhline(returns[name], color="black", linewidth=1, linestyle=style, label=name)
    axes.set(xlabel="minutes", ylabel="mean return of an episode", title=f"{given.task}, {given.envs} worlds")
    axes.legend()
    figure.savefig(f"ppo_{given.task}.png")
