"""What the ground's benchmarks share: time on a core, child processes, and `target/bench.json`."""

from __future__ import annotations

import json
import os
import socket
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[3]
BENCH_JSON = ROOT / "target/bench.json"
_TICKS_HZ = os.sysconf("SC_CLK_TCK")


def record(key: str, value: Any) -> None:
    """Sets one key of `target/bench.json`, keeping the others."""
    figures: dict[str, Any] = json.loads(BENCH_JSON.read_text(encoding="utf-8")) if BENCH_JSON.exists() else {}
    figures[key] = value
    BENCH_JSON.parent.mkdir(exist_ok=True)
    BENCH_JSON.write_text(json.dumps(figures, indent=2, sort_keys=True) + "\n", encoding="utf-8")


def core_seconds_of_threads(pid: int) -> dict[str, float]:
    """Seconds on a core of each thread of a process, summed by the thread's name."""
    total: dict[str, float] = {}
    for task in Path(f"/proc/{pid}/task").iterdir():
        text = (task / "stat").read_text()
        name, fields = text[text.index("(") + 1 : text.rindex(")")], text[text.rindex(")") + 2 :].split()
        total[name] = total.get(name, 0.0) + (int(fields[11]) + int(fields[12])) / _TICKS_HZ
    return total


def waited_seconds(pid: int) -> float:
    """Seconds that the threads of a process have been ready to run and had no core: large on a busy machine."""
    return sum(int((task / "schedstat").read_text().split()[1]) for task in Path(f"/proc/{pid}/task").iterdir()) / 1e9


def memory_mb(pid: int) -> float:
    """Memory of a process that is its own and in use, MB."""
    for line in Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines():
        if line.startswith("Anonymous:"):
            return int(line.split()[1]) * 1024 / 1e6
    raise OSError(f"no memory figures of process {pid}")


def free_port(kind: socket.SocketKind = socket.SOCK_STREAM) -> int:
    """A port that was free a moment ago."""
    with socket.socket(socket.AF_INET, kind) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def verdict(met: bool) -> str:
    """Of a target."""
    return "met" if met else "missed"
