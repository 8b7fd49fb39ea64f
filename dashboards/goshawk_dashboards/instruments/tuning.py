"""What the vehicle's tuning file says of its estimators: how far they go, and what they believe."""

from __future__ import annotations

import tomllib
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class GateTuning:
    """By what the target filter judges a detection; the names are the tuning file's."""

    gate_sigmas: float
    min_objectness: float
    keep_objectness: float
    lateral_variance_m2: float
    range_variance_m2: float
    variance_distance_m: float


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """None: it is not known here, as of a vehicle that is only heard."""

    disturbance_limit_mps2: float | None = None
    gate: GateTuning | None = None

    @staticmethod
    def of_toml(text: str) -> Tuning:
        """Of a tuning file; empty, or of another version: nothing is known."""
        try:
            known = tomllib.loads(text)
            detection, target = known["planner"]["detection"], known["planner"]["target"]
            return Tuning(
                disturbance_limit_mps2=float(known["observer"]["limit_mps2"]),
                gate=GateTuning(
                    gate_sigmas=float(target["gate_sigmas"]),
                    min_objectness=float(detection["min_objectness"]),
                    keep_objectness=float(detection["keep_objectness"]),
                    lateral_variance_m2=float(target["lateral_variance_m2"]),
                    range_variance_m2=float(target["range_variance_m2"]),
                    variance_distance_m=float(target["variance_distance_m"]),
                ),
            )
        except (tomllib.TOMLDecodeError, KeyError, TypeError, ValueError):
            return Tuning()
