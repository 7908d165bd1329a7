"""A training step of CLS2R's networks in Burn and in PyTorch, in turns: pip install torch numpy; then

    cargo build --release -p trainer --example step            # or with --features tch
    compare_steps.py CONFIG BATCH COLUMNS STEPS target/release/examples/step BACKEND ...

builds in PyTorch the networks and losses that the program says the config has, sees that they have as many weights, and prints the median
seconds of a step of each BACKEND (flex, tch, wgpu) and of PyTorch, and their ratio."""

import json
import statistics
import subprocess
import sys
import time

import torch
import torch.nn.functional as F
from torch import nn


def pad(x, by, border):
    x = F.pad(x, (0, 0, by, by), mode="reflect")
    return F.pad(x, (by, by, 0, 0), mode="circular" if border == "turn" else "reflect")


def blur(weights, channels, total):
    w = torch.tensor(weights)
    w = torch.outer(w, w)
    return (w * (total / w.sum())).repeat(channels, 1, 1, 1)


class Halve(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.register_buffer("kernel", blur([1.0, 2.0, 1.0], channels, 1.0))

    def forward(self, x, border):
        return F.conv2d(pad(x, 1, border), self.kernel, stride=2, groups=x.shape[1])


class Double(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.register_buffer("kernel", blur([1.0, 3.0, 3.0, 1.0], channels, 4.0))

    def forward(self, x, border):
        rings, columns = x.shape[2:]
        x = pad(x, 1, border) if border == "turn" else F.pad(x, (1, 1, 1, 1), mode="replicate")
        x = F.conv_transpose2d(x, self.kernel, stride=2, padding=2, groups=x.shape[1])
        return x[:, :, 1 : 1 + 2 * rings, 1 : 1 + 2 * columns]


class Stage(nn.Module):
    def __init__(self, norm, start, end, size=3):
        super().__init__()
        self.conv, self.norm, self.by = nn.Conv2d(start, end, size), norm(end), size // 2

    def forward(self, x, border):
        return self.norm(self.conv(pad(x, self.by, border)))


class Block(nn.Module):
    def __init__(self, norm, channels):
        super().__init__()
        self.first, self.second = Stage(norm, channels, channels), Stage(norm, channels, channels)

    def forward(self, x, border):
        return x + self.second(F.relu(self.first(x, border)), border)


class Encoder(nn.Module):
    def __init__(self, norm, channels, width, blocks):
        super().__init__()
        self.stem = Stage(norm, channels, width, 7)
        self.down = nn.ModuleList(Stage(norm, width << i, width << (i + 1)) for i in range(2))
        self.halve = nn.ModuleList(Halve(width << (i + 1)) for i in range(2))
        self.blocks = nn.ModuleList(Block(norm, width << 2) for _ in range(blocks))

    def forward(self, x, border, seen, rings=0):
        x = F.relu(self.stem.norm(self.stem.conv(pad(x, self.stem.by, border)) + rings))
        for stage, halve in zip(self.down, self.halve):
            x = stage.conv(pad(x, 1, border))
            seen.append(x)
            x = halve(F.relu(stage.norm(x)), border)
        for i, block in enumerate(self.blocks):
            x = block(x, border)
            if i == 0:
                seen.append(x)
        return x


class Generator(nn.Module):
    def __init__(self, of):
        super().__init__()
        self.of, width, joined = of, of["width"], of["blocks"] // 2
        norm = nn.InstanceNorm2d if of["norm"] == "instance" else nn.BatchNorm2d
        self.image = Encoder(norm, 2, width, joined)
        self.condition = Encoder(norm, 1, width, joined) if of["condition"] else None
        self.blocks = nn.ModuleList(Block(norm, width << 2) for _ in range(joined, of["blocks"]))
        self.twice = nn.ModuleList(Double(width << (i + 1)) for i in (1, 0))
        self.up = nn.ModuleList(Stage(norm, width << (i + 1), width << i) for i in (1, 0))
        self.head = nn.Conv2d(width, 3, 7)
        by_ring = lambda channels: nn.Parameter(torch.zeros(1, channels, of["rings"], 1)) if of["rings"] else 0
        self.stem_rings, self.head_rings = by_ring(width), by_ring(3)

    def features(self, image, condition):
        border = self.of["border"]
        seen = [pad(image, 3, border)]
        x = self.image(image, border, seen, self.stem_rings)
        if self.condition is not None:
            x = x + self.condition(condition, border, [])
        x = self.blocks[0](x, border)
        return x, seen + [x]

    def forward(self, image, condition):
        border = self.of["border"]
        x, seen = self.features(image, condition)
        for block in self.blocks[1:]:
            x = block(x, border)
        for twice, stage in zip(self.twice, self.up):
            x = F.relu(stage(twice(x, border), border))
        x = self.head(pad(x, 3, border)) + self.head_rings
        said = x[:, :2]
        if self.of["output"] == "correction":
            image = image + torch.cat([said[:, :1].tanh() * self.of["range_reach"], said[:, 1:]], 1)
        else:
            image = said.tanh()
        uniform = torch.rand_like(x[:, 2:])
        soft = torch.sigmoid(x[:, 2:] + torch.log(uniform / (1 - uniform)))
        reported = soft + ((soft > 0.5).float() - soft).detach()
        return (image + 1) * reported - 1, seen


class Discriminator(nn.Module):
    def __init__(self, of):
        super().__init__()
        norm = nn.InstanceNorm2d if of["norm"] == "instance" else nn.BatchNorm2d
        width = [of["width"] << min(i, 3) for i in range(of["halvings"] + 1)]
        self.first = nn.Conv2d(2, width[0], 4, padding=1)
        self.halve = nn.ModuleList(Halve(w) for w in width[:-1])
        self.conv = nn.ModuleList(nn.Conv2d(a, b, 4, padding=1) for a, b in zip(width, width[1:]))
        self.norm = nn.ModuleList(norm(w) for w in width[1:])
        self.head = nn.Conv2d(width[-1], 1, 4, padding=1)

    def forward(self, x):
        x = F.leaky_relu(self.first(x), 0.2)
        for halve, conv, norm in zip(self.halve, self.conv, self.norm):
            x = F.leaky_relu(norm(conv(halve(x, "mirror"))), 0.2)
        return self.head(x)


class Heads(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.heads = nn.ModuleList(nn.Sequential(nn.Linear(n, 256), nn.ReLU(), nn.Linear(256, 256)) for n in channels)

    def loss(self, answer, question, patches):
        total = 0
        for head, a, q in zip(self.heads, answer, question):
            places = torch.randperm(a.shape[2] * a.shape[3])[:patches]
            a, q = (F.normalize(head(x.flatten(2)[:, :, places].transpose(1, 2)), dim=2) for x in (a, q))
            alike = a @ q.detach().transpose(1, 2) / 0.07
            right = torch.arange(alike.shape[1]).expand(alike.shape[0], -1)
            total = total + F.cross_entropy(alike.transpose(1, 2), right)
        return total / len(self.heads)


class Torch:
    def __init__(self, of):
        torch.set_num_threads(len(__import__("os").sched_getaffinity(0)))
        width, losses = of["generator"]["width"], of["losses"]
        self.losses, self.patches = losses, losses["patches"]
        self.generator, self.discriminator = Generator(of["generator"]), Discriminator(of["discriminator"])
        self.heads = Heads([2, width << 1, width << 2, width << 2, width << 2])
        for name, network in [("generator", self.generator), ("discriminator", self.discriminator), ("heads", self.heads)]:
            weights = sum(p.numel() for p in network.parameters())
            assert weights == of["parameters"][name], f"{name}: {weights} weights here, {of['parameters'][name]} there"
        adam = lambda *networks: torch.optim.Adam([p for n in networks for p in n.parameters()], 5e-5, betas=(0.5, 0.999))
        self.of_generator, self.of_discriminator = adam(self.generator, self.heads), adam(self.discriminator)
        batch, rings, columns = of["size"]
        scan = lambda channels: torch.rand(batch, channels, rings, columns) * 2 - 1
        self.simulated, self.real = (scan(2), scan(1)), (scan(2), scan(1))

    def step(self):
        started = time.perf_counter()
        answered, asked = self.generator(*self.simulated)
        same, shown = self.generator(*self.real)
        judge = self.discriminator
        loss = ((judge(self.real[0]) - 1).square().mean() + judge(answered.detach()).square().mean()) / 2
        self.of_discriminator.zero_grad()
        loss.backward()
        self.of_discriminator.step()
        for p in judge.parameters():
            p.requires_grad_(False)
        contrast = lambda answer, condition, question: self.heads.loss(
            self.generator.features(answer, condition)[1], question, self.patches
        )
        total = (judge(answered) - 1).square().mean()
        total = total + self.losses["contrast"] * contrast(answered, self.simulated[1], asked)
        total = total + self.losses["contrast_identity"] * contrast(same, self.real[1], shown)
        self.of_generator.zero_grad()
        total.backward()
        self.of_generator.step()
        for p in judge.parameters():
            p.requires_grad_(True)
        total.item()
        return time.perf_counter() - started


class Burn:
    def __init__(self, program, config, backend, batch, columns):
        command = [program, config, backend, batch, columns]
        self.child = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        self.says = json.loads(self.child.stdout.readline())

    def step(self):
        self.child.stdin.write("\n")
        self.child.stdin.flush()
        return float(self.child.stdout.readline())


config, batch, columns, steps, program, *backends = sys.argv[1:]
burns = {backend: Burn(program, config, backend, batch, columns) for backend in backends}
says = next(iter(burns.values())).says
assert says["method"] == "cls2r", f"the method is {says['method']}"
contestants = {**burns, "PyTorch": Torch(says)}
seconds = {name: [] for name in contestants}
for step in range(int(steps) + 1):
    for name, contestant in contestants.items():
        took = contestant.step()
        if step > 0:  # the first one warms up
            seconds[name].append(took)
median = {name: statistics.median(took) for name, took in seconds.items()}
print(f"{' × '.join(map(str, says['size']))}, {says['parameters']['generator']} weights in the generator, {steps} steps in turns")
for name, took in median.items():
    print(f"{name}: {took:.2f} s a step, {took / median['PyTorch']:.2f} of PyTorch's")
