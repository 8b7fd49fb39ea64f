"""Plans a flight again for the review: by the vehicle's own program, whose planner it is."""

from __future__ import annotations

import hashlib
import json
import subprocess
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from goshawk_dashboards.log.flight import LogError, header_of
from goshawk_dashboards.review.altering import Alteration, AlterError

LONGEST_S = 300.0
"""A program that has not answered by then never will."""


def replanner_of(programs: Path, policies: Sequence[Path]) -> AirReplanner | None:
    """By the program of that folder, with these policies; None: it is not there.

    Raises LogError, one line, for a policy that cannot be read.
    """
    for path in policies:
        if not path.is_file():
            raise LogError(f"cannot read the policy {path}: there is no such file")
    program = programs / "goshawk-air"
    return AirReplanner(program, policies) if program.is_file() else None


class AirReplanner:
    """Runs ``goshawk-air replay --from`` with one of the policies that the reviewer named."""

    def __init__(self, program: Path, policies: Sequence[Path]) -> None:
        self._program = program
        self._policies = {path.name: path for path in policies}
        self._by_sha256: dict[str, Path] | None = None

    @property
    def policies(self) -> tuple[str, ...]:
        """Their files' names; a browser names no path."""
        return tuple(self._policies)

    def replan(self, flight: Path, alteration: Alteration, out: Path) -> Mapping[str, Any]:
        """Writes ``out`` and gives the program's figures. Raises AlterError."""
        named = alteration.policy
        if named is not None and named not in self._policies:
            raise AlterError(f"{named} is none of the policies: name its file, goshawk review LOG --policy FILE")
        if named is None and not alteration.changes:
            raise AlterError("nothing is altered: choose another policy, or change a parameter")
        policy = self._flown(flight) if named is None else self._policies[named]
        figures = out.with_suffix(".json")
        command = [self._program, "replay", flight, "--from", f"{alteration.from_s:.9f}", "--for", alteration.for_s]
        command += [f"--set={change}" for change in alteration.changes]
        command += [] if policy is None else ["--policy", policy]
        command += ["--out", out, "--json", figures]
        try:
            done = subprocess.run(
                [str(part) for part in command], capture_output=True, text=True, timeout=LONGEST_S, check=False
            )
            if done.returncode != 0:
                said = done.stderr.strip().splitlines() or [f"it ended with status {done.returncode}"]
                raise AlterError(said[-1].removeprefix("goshawk-air: "))
            return json.loads(figures.read_text(encoding="utf-8"))
        except subprocess.TimeoutExpired:
            raise AlterError(f"{self._program} did not answer within {LONGEST_S:.0f} s") from None
        except OSError as error:
            raise AlterError(f"cannot run {self._program}: {error.strerror}") from error
        finally:
            figures.unlink(missing_ok=True)

    def _flown(self, flight: Path) -> Path | None:
        """The policy that flew, if it is among those named: it answers where the network is asked something else."""
        if self._by_sha256 is None:
            files = self._policies.values()
            self._by_sha256 = {hashlib.sha256(path.read_bytes()).hexdigest(): path for path in files}
        header = header_of(flight)
        return None if header is None else self._by_sha256.get(header.policy_sha256)
