"""What a check finds, one line each."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

_FRAMES_SHOWN = 8
_SCENES_SHOWN = 6


@dataclass(frozen=True, kw_only=True)
class Finding:
    """One thing that is wrong in one scene."""

    severity: Literal["error", "warning"]
    kind: str
    """A word for programs, the same for the same kind of damage."""
    where: str
    """The scene's name, or the data set's."""
    frames: tuple[int, ...] = ()
    """Which of its frames; empty: all, or none in particular."""
    what: str
    advice: str

    def line(self) -> str:
        """For people."""
        frames = ""
        if self.frames:
            shown = ", ".join(str(f) for f in self.frames[:_FRAMES_SHOWN])
            more = len(self.frames) - _FRAMES_SHOWN
            frames = f"frame{'s' if len(self.frames) > 1 else ''} {shown}{f' and {more} more' if more > 0 else ''}: "
        return f"{self.severity}: {self.where}: {frames}{self.what} → {self.advice}"


def numbers(mask: ArrayLike) -> tuple[int, ...]:
    """The indices that a mask picks."""
    return tuple(int(i) for i in np.flatnonzero(np.asarray(mask)))


def lines(findings: Iterable[Finding]) -> list[str]:
    """All as text, errors first; of a kind that many scenes share, the first few."""
    groups: dict[tuple[str, str], list[Finding]] = {}
    for finding in sorted(findings, key=lambda f: (f.severity, f.where)):
        groups.setdefault((finding.severity, finding.kind), []).append(finding)
    out: list[str] = []
    for (severity, kind), group in groups.items():
        out += [finding.line() for finding in group[:_SCENES_SHOWN]]
        more = len(group) - _SCENES_SHOWN
        if more > 0:
            out.append(f"{severity}: and {more} more of this kind ({kind}); --json lists them all")
    return out
