"""Where a run computes: a CPU, a GPU, or as many processes as `torchrun` started, each with a part of every step.

Together they do what one alone would: the step's images and random numbers do not depend on their number, each process
computes its share of the step's loss, and gradients and batch norms' statistics are of all images.
"""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import timedelta
from pathlib import Path
from typing import TypeVar, cast

import torch
import torch.distributed as dist
from torch import Tensor, nn

from goshawk_train.errors import TrainerError
from goshawk_train.run.norm import JointBatchNorm

Found = TypeVar("Found")
PATIENCE = timedelta(hours=2)
"""How long processes wait for one another: the first also validates and flies. A dead one is noticed at once."""

SETTLED_S = 0.5
"""Gloo's threads let go of what they summed well within this."""

BF16 = ("avx512_bf16", "amx_bf16", "bf16")
"""A processor's instructions for bfloat16, as PyTorch names them; the last is ARM's."""


@dataclass(frozen=True)
class Workers:
    """This process among the `count` of a run."""

    device: torch.device
    rank: int = 0
    count: int = 1
    local_rank: int = 0
    """Among those of this machine."""

    @property
    def first(self) -> bool:
        """Whether this one prints and writes."""
        return self.rank == 0

    @property
    def has_bf16(self) -> bool:
        """Whether it computes with bfloat16 by instructions of its own: without them that is slower than in 32 bits."""
        if self.device.type == "cuda":
            return torch.cuda.is_bf16_supported(including_emulation=False)
        able = torch.cpu.get_capabilities()
        return any(able.get(name, False) for name in BF16)

    def hardware(self) -> str:
        """What a run computes on, for its record."""
        if self.device.type == "cuda":
            return f"{self.count} x {torch.cuda.get_device_name(self.device)}"
        threads = self.count * torch.get_num_threads()
        instructions = torch.backends.cpu.get_cpu_capability()
        return f"{_processor()} with {instructions}, {threads} thread{'s' if threads > 1 else ''}"

    def part(self, count: int) -> slice:
        """This process's of `count` things in a row; the parts of all are as equal as can be."""
        return slice(count * self.rank // self.count, count * (self.rank + 1) // self.count)

    def join_norms(self, network: nn.Module) -> None:
        """Let the batch norms of a network see the images of all processes; the names of its weights stay."""
        if self.count == 1:
            return
        for parent in list(network.modules()):
            for name, norm in parent.named_children():
                if isinstance(norm, nn.BatchNorm2d):
                    setattr(parent, name, JointBatchNorm.of(norm))

    def share(self, network: nn.Module) -> None:
        """Give every process the first one's weights."""
        if self.count > 1:
            for value in network.state_dict().values():
                dist.broadcast(value, src=0)

    def total(self, values: Sequence[Tensor]) -> None:
        """Replace each by its sum over all processes."""
        if self.count == 1:
            return
        flat = torch.cat([value.flatten() for value in values])
        dist.all_reduce(flat)
        parts = cast("tuple[Tensor, ...]", flat.split([value.numel() for value in values]))
        for value, part in zip(values, parts, strict=True):
            value.copy_(part.view_as(value))

    def agree(self, find: Callable[[], Found]) -> Found:
        """What the first process finds, in all of them: only its disk has the run. Its `TrainerError` is raised in
        all."""
        if self.count == 1:
            return find()
        found: list[Found | TrainerError | None] = [None]
        if self.first:
            try:
                found = [find()]
            except TrainerError as error:
                found = [error]
        dist.broadcast_object_list(found, src=0, device=self.device)
        if isinstance(found[0], TrainerError):
            raise found[0]
        return cast("Found", found[0])

    def one_by_one(self, act: Callable[[], Found]) -> Found:
        """Do something in the first process of each machine, then in its others: they find what it made."""
        if self.count == 1:
            return act()
        done = act() if self.local_rank == 0 else None
        dist.barrier()
        return act() if done is None else done

    def any(self, flag: bool) -> bool:
        """Whether the flag is up in any process: they stop at the same step."""
        if self.count == 1:
            return flag
        flags = torch.tensor([float(flag)], device=self.device)
        dist.all_reduce(flags)
        return bool(flags.item())


def _processor() -> str:
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def join() -> Workers:
    """This process's place: the first GPU if there is one, else the CPU; under `torchrun` the GPU of its local rank."""
    count, rank, local = (
        int(os.environ.get(n, d)) for n, d in (("WORLD_SIZE", "1"), ("RANK", "0"), ("LOCAL_RANK", "0"))
    )
    gpu = torch.cuda.is_available()
    device = torch.device("cuda", local) if gpu else torch.device("cpu")
    if gpu:
        torch.cuda.set_device(device)
    if count > 1 and not dist.is_initialized():
        dist.init_process_group("nccl" if gpu else "gloo", timeout=PATIENCE)
    return Workers(device, rank, count, local)


def leave() -> None:
    """The end of what `join` began. Gloo's threads get to let go of the last sums first: for that they need Python, and
    one that is still about it when Python ends aborts the process, whose work was done."""
    if dist.is_initialized():
        time.sleep(SETTLED_S)
        dist.destroy_process_group()
