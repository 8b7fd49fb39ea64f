"""The figures of a report, each with the numbers that it shows. A figure whose data were not logged is left out."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure as Canvas
from numpy.typing import NDArray

from goshawk_dashboards.charts.clearance import Clearance
from goshawk_dashboards.charts.errors import TargetErrors
from goshawk_dashboards.exports.drawing import speed_colors_P3
from goshawk_dashboards.log.flight import Flight
from goshawk_dashboards.report.canvas import Figure, Palette, columns_of, legend, mark_phases
from goshawk_dashboards.report.latency import Latencies
from goshawk_dashboards.report.tracking import SHAKING_HZ, Spectrum

AXES = ("east", "north", "up")
MOST_ROWS = 2000
"""Of a curve; a longer flight is drawn at a lower rate."""
PATH_ROWS = 900
FARTHEST_M = 1e7
"""From where it began: no vehicle gets farther, and a map that reached there would show nothing."""
_SPEED_LEAST_MPS = 0.5


@dataclass(frozen=True, kw_only=True, eq=False)
class Material:
    """A flight and what was worked out of it."""

    flight: Flight
    seen: Clearance | None
    errors: TargetErrors | None
    latencies: Latencies
    spectrum: Spectrum | None


def figures(material: Material) -> list[Figure]:
    """All that the log allows, in the order of reading."""
    makers = (
        path_figure,
        velocity_figure,
        disturbance_figure,
        clearance_figure,
        target_figure,
        vibration_figure,
        latency_figure,
    )
    found = (make(material) for make in makers)
    return [figure for figure in found if figure is not None]


def _rate(flight: Flight, most: int) -> float | None:
    """At most so many rows of a channel over the whole flight."""
    return None if flight.count("control") <= most else most / max(flight.duration_s, 1e-3)


def path_figure(material: Material) -> Figure | None:
    """Where it flew, from above and from the side, coloured by speed."""
    flight = material.flight
    control = flight.columns("control", ["pos_world", "vel_world"], max_hz=_rate(flight, PATH_ROWS))
    placed = _placed(control["pos_world"]) & np.isfinite(control["vel_world"]).all(axis=1)
    pos_M3, times_s_M = control["pos_world"][placed], control.times_s[placed]
    if len(pos_M3) < 2:
        return None
    speed_M = np.linalg.norm(control["vel_world"][placed], axis=1)
    target = flight.columns("target", ["pos_world", "confirmed"], max_hz=_rate(flight, PATH_ROWS))
    confirmed = target["confirmed"].astype(bool) & _placed(target["pos_world"])
    target_M3 = target["pos_world"][confirmed]
    truth_M3 = flight.columns("sim_truth", ["target_pos_world"], max_hz=_rate(flight, PATH_ROWS))["target_pos_world"]
    truth_M3 = truth_M3[_placed(truth_M3)]
    top_mps = max(float(speed_M.max()), _SPEED_LEAST_MPS)

    low_3, high_3, size_in = _map_frame(np.concatenate([pos_M3, target_M3, truth_M3]))

    def draw(canvas: Canvas, palette: Palette) -> None:
        above, side = canvas.subplots(2, 1, sharex=True, height_ratios=(high_3 - low_3)[1:].tolist())
        for axes, row in ((above, 1), (side, 2)):
            if len(truth_M3):
                axes.plot(truth_M3[:, 0], truth_M3[:, row], color=palette.soft, lw=1.0, ls=":", label="target, true")
            if len(target_M3):
                axes.plot(target_M3[:, 0], target_M3[:, row], color=palette.target, lw=1.0, label="target, estimated")
            segments = np.stack([pos_M3[:-1][:, [0, row]], pos_M3[1:][:, [0, row]]], axis=1)
            colors = speed_colors_P3(speed_M[1:], top_mps) / 255.0
            axes.add_collection(LineCollection(list(segments), colors=colors, lw=2.6, capstyle="round"))
            axes.plot(*pos_M3[0, [0, row]], "o", mfc=palette.paper, mec=palette.ink, ms=6, label="take-off", ls="none")
            axes.plot(*pos_M3[-1, [0, row]], "s", mfc=palette.ink, mec=palette.ink, ms=5, label="end", ls="none")
            axes.set_ylabel(f"{AXES[row]}, m")
            axes.set_xlim(low_3[0], high_3[0])
            axes.set_ylim(low_3[row], high_3[row])
            axes.set_aspect("equal")
        side.set_xlabel("east, m")
        legend(above, 4)
        _speed_bar(canvas, above, side, top_mps)

    vehicle = {"time_s": times_s_M, **columns_of("pos", pos_M3, "m"), "speed_mps": speed_M}
    estimate = {"time_s": target.times_s[confirmed], **columns_of("pos", target_M3, "m")}
    return Figure(
        name="path",
        title="Path",
        caption="From above and from the side, coloured by speed.",
        size_in=size_in,
        draw=draw,
        tables={"path": vehicle, "path_target": estimate},
    )


def _placed(points_M3: NDArray[Any]) -> NDArray[np.bool_]:
    """Which of them a map can show; NaN is none."""
    return np.all(np.abs(points_M3) < FARTHEST_M, axis=1)


def _map_frame(points_M3: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], tuple[float, float]]:
    """Limits of the maps, m, and the figure's size, inches, such that a metre is as long in both, east and up."""
    wide_in, least_in, most_in, around_in = 8.6, 2.4, 5.6, 1.0
    middle_3 = (points_M3.max(axis=0) + points_M3.min(axis=0)) / 2
    span_3 = np.ptp(points_M3, axis=0) + (2.0, 2.0, 1.0)
    high_in = wide_in * (span_3[1] + span_3[2]) / span_3[0]
    if high_in > most_in:
        span_3[0] *= high_in / most_in
    elif high_in < least_in:
        span_3[1] += (least_in - high_in) * span_3[0] / wide_in
    size_in = (10.0, min(max(high_in, least_in), most_in) + around_in)
    return middle_3 - span_3 / 2, middle_3 + span_3 / 2, size_in


def _speed_bar(canvas: Canvas, above: Any, side: Any, top_mps: float) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import ListedColormap, Normalize

    colors = speed_colors_P3(np.linspace(0.0, top_mps, 64), top_mps) / 255.0
    scale = ScalarMappable(Normalize(0.0, top_mps), ListedColormap(colors.tolist()))
    bar = canvas.colorbar(scale, ax=[above, side], label="speed, m/s", fraction=0.02, pad=0.01)
    bar.outline.set_visible(False)  # type: ignore[operator]


def velocity_figure(material: Material) -> Figure | None:
    """Speed along each axis."""
    flight = material.flight
    control = flight.columns("control", ["vel_world"], max_hz=_rate(flight, MOST_ROWS))
    if len(control) < 2:
        return None
    vel_M3 = control["vel_world"]
    speed_M = np.linalg.norm(vel_M3, axis=1)

    def draw(canvas: Canvas, palette: Palette) -> None:
        axes = canvas.subplots()
        mark_phases(axes, flight.phases, palette, named=True)
        for k, color in enumerate((palette.east, palette.north, palette.up)):
            axes.plot(control.times_s, vel_M3[:, k], color=color, label=AXES[k])
        axes.plot(control.times_s, speed_M, color=palette.ink, lw=1.0, alpha=0.75, label="speed")
        axes.set_ylabel("m/s")
        axes.set_xlabel("s")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.08), ncols=4, borderaxespad=0.0)

    return Figure(
        name="velocity",
        title="Velocity",
        caption="Along each axis of the world, and speed.",
        size_in=(10.0, 3.0),
        draw=draw,
        tables={"velocity": {"time_s": control.times_s, **columns_of("vel", vel_M3, "mps"), "speed_mps": speed_M}},
    )


def disturbance_figure(material: Material) -> Figure | None:
    """The paper's figure of the disturbance observer, for each axis."""
    flight = material.flight
    names = {"desired": "acc_des_world", "attitude": "acc_att_world", "disturbance": "acc_disturbance_world",
             "measured": "acc_meas_world"}  # fmt: skip
    control = flight.columns("control", [*names.values(), "thrust_n"], max_hz=_rate(flight, MOST_ROWS))
    # Without thrust there is no command to speak of, and on the ground none is an estimate of the air.
    flown = (control["thrust_n"] > 0.0) & flight.airborne_M(control.times_s)
    if np.count_nonzero(flown) < 2:
        return None
    curves = {name: np.where(flown[:, None], control[field], np.nan) for name, field in names.items()}
    felt = bool(np.isfinite(curves["measured"]).any())
    shown = [name for name in ("measured", "desired", "attitude", "disturbance") if felt or name != "measured"]
    truth = flight.columns("sim_truth", ["acc_world"], max_hz=_rate(flight, MOST_ROWS))
    true_M3 = np.where(flight.airborne_M(truth.times_s)[:, None], truth["acc_world"], np.nan)
    simulated = bool(np.isfinite(true_M3).any())

    def draw(canvas: Canvas, palette: Palette) -> None:
        rows = canvas.subplots(3, 1, sharex=True)
        for k, axes in enumerate(rows):
            mark_phases(axes, flight.phases, palette, named=k == 0)
            for name in shown:
                axes.plot(control.times_s, curves[name][:, k], color=getattr(palette, name), lw=1.1, label=name)
            if simulated:
                axes.plot(truth.times_s, true_M3[:, k], color=palette.ink, lw=0.8, ls=":", label="true")
            axes.set_ylabel(f"{AXES[k]}, m/s²")
        rows[2].set_xlabel("s")
        rows[0].legend(loc="lower center", bbox_to_anchor=(0.5, 1.13), ncols=5, borderaxespad=0.0)

    table = {"time_s": control.times_s}
    for name, values_M3 in curves.items():
        table |= columns_of(name, values_M3, "mps2")
    tables = {"disturbance": table}
    if simulated:
        tables["disturbance_true"] = {"time_s": truth.times_s, **columns_of("true", true_M3, "mps2")}
    came = "what the autopilot's IMU felt (measured): measured should follow desired."
    return Figure(
        name="disturbance",
        title="Disturbance",
        caption="The trajectory's acceleration (desired), what the commanded attitude and thrust alone would give "
        "(attitude: desired and lead, less disturbance), the observer's estimate (disturbance), and "
        + (came if felt else "no IMU: the log has no measured acceleration."),
        size_in=(10.0, 6.2),
        draw=draw,
        tables=tables,
    )


def clearance_figure(material: Material) -> Figure | None:
    """How near obstacles were."""
    flight, seen = material.flight, material.seen
    truth = flight.columns("sim_truth", ["clearance_m"], max_hz=_rate(flight, MOST_ROWS))
    if seen is not None and not np.isfinite(seen.nearest_m_M).any():
        seen = None
    if seen is None and len(truth) < 2:
        return None

    def draw(canvas: Canvas, palette: Palette) -> None:
        axes = canvas.subplots()
        mark_phases(axes, flight.phases, palette, named=True)
        if len(truth) > 1:
            axes.plot(
                truth.times_s, truth["clearance_m"], color=palette.soft, lw=1.0, ls="--", label="true, of the hull"
            )
        if seen is not None:
            axes.plot(seen.times_s_M, seen.nearest_m_M, color=palette.vehicle, lw=1.5, label="seen, of the middle")
        axes.set_ylim(0.0, 5.0)
        axes.set_ylabel("m")
        axes.set_xlabel("s")
        axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.08), ncols=2, borderaxespad=0.0)

    tables: dict[str, dict[str, NDArray[Any]]] = {}
    if seen is not None:
        tables["clearance"] = {"time_s": seen.times_s_M, "nearest_seen_m": seen.nearest_m_M}
    if len(truth) > 1:
        tables["clearance_true"] = {"time_s": truth.times_s, "clearance_m": truth["clearance_m"]}
    return Figure(
        name="clearance",
        title="Clearance",
        caption="Distance to the nearest surface that depth showed within the last 3 s and 4 m, without the ground and "
        "the target; a gap: none.",
        size_in=(10.0, 2.8),
        draw=draw,
        tables=tables,
    )


def target_figure(material: Material) -> Figure | None:
    """The error of the target's estimate."""
    errors = material.errors
    if errors is None:
        return None
    lateral, longitudinal = errors.lateral_m_M, errors.longitudinal_m_M

    def draw(canvas: Canvas, palette: Palette) -> None:
        plane, across, along = canvas.subplots(1, 3, width_ratios=(1.2, 1.0, 1.0))
        plane.plot(lateral, longitudinal, ".", color=palette.target, ms=3, alpha=0.5)
        plane.set_xlabel("lateral, m")
        plane.set_ylabel("longitudinal, m")
        plane.axhline(0.0, color=palette.rule, lw=1.0)
        plane.axvline(0.0, color=palette.rule, lw=1.0)
        plane.set_aspect("equal", adjustable="datalim")
        for axes, name, values in ((across, "lateral", lateral), (along, "longitudinal", longitudinal)):
            low, high = np.percentile(values, [5.0, 95.0])
            axes.hist(values, bins=40, color=palette.target, alpha=0.75)
            for edge in (low, high):
                axes.axvline(edge, color=palette.ink, lw=1.0, ls="--")
            axes.set_title(f"{name}: 5–95 % {low:+.2f} … {high:+.2f} m")
            axes.set_xlabel("m")
            axes.yaxis.set_visible(False)

    table = {"time_s": errors.times_s_M, "lateral_m": lateral, "longitudinal_m": longitudinal}
    return Figure(
        name="target_error",
        title="Target error",
        caption="Estimate less truth in the plane, across and along the line of sight.",
        size_in=(10.0, 3.2),
        draw=draw,
        tables={"target_error": table},
    )


def vibration_figure(material: Material) -> Figure | None:
    """What the IMU felt by frequency."""
    found = material.spectrum
    if found is None:
        return None
    parts = (("specific force, m/s²/√Hz", found.force_mps2_F3), ("angular rate, rad/s/√Hz", found.rate_rps_F3))

    def draw(canvas: Canvas, palette: Palette) -> None:
        for axes, (title, values_F3) in zip(canvas.subplots(1, 2), parts, strict=True):
            for k, (name, color) in enumerate(
                zip(("forward", "left", "up"), (palette.east, palette.north, palette.up), strict=True)
            ):
                axes.plot(found.hz_F[1:], np.maximum(values_F3[1:, k], 1e-6), color=color, label=name)
            axes.axvline(SHAKING_HZ, color=palette.rule, lw=1.0, ls="--")
            axes.set_yscale("log")
            axes.set_title(title)
            axes.set_xlabel("Hz")
            axes.legend(loc="upper right", ncols=3)

    table = {"hz": found.hz_F}
    for prefix, unit, values_F3 in (
        ("force", "mps2_per_rthz", found.force_mps2_F3),
        ("rate", "rps_per_rthz", found.rate_rps_F3),
    ):
        table |= {f"{prefix}_{axis}_{unit}": values_F3[:, k] for k, axis in enumerate(("forward", "left", "up"))}
    return Figure(
        name="vibration",
        title="Vibration",
        caption=f"Of the autopilot's IMU in the air. What lies above {SHAKING_HZ:g} Hz (dashed) is vibration.",
        size_in=(10.0, 3.0),
        draw=draw,
        tables={"vibration": table},
    )


def latency_figure(material: Material) -> Figure | None:
    """Histograms of what the log's stamps tell."""
    found = material.latencies
    parts = [
        (name, title, values)
        for name, title, values in (
            ("frame_to_plan", "exposure to plan", found.frame_to_plan_ms),
            ("plan_age", "age of the flown plan", found.plan_age_ms),
            ("control_period", "controller's period", found.control_period_ms),
        )
        if len(values)
    ]
    if not parts:
        return None

    def draw(canvas: Canvas, palette: Palette) -> None:
        row = np.atleast_1d(canvas.subplots(1, len(parts)))
        for axes, (_, title, values) in zip(row, parts, strict=True):
            p50, p99 = np.percentile(values, [50.0, 99.0])
            low, high = float(values.min()), max(float(p99) * 1.15, float(values.min()) + 0.1)
            axes.hist(np.minimum(values, high), bins=40, range=(low - 0.02 * (high - low), high), color=palette.vehicle)
            axes.set_yscale("log")
            axes.set_ylim(bottom=0.8)
            axes.set_title(f"{title}\np50 {p50:.2f}, p99 {p99:.2f}, max {values.max():.2f} ms")
            axes.set_xlabel("ms")
        row[0].set_ylabel("times")

    return Figure(
        name="latency",
        title="Latency",
        caption="By the stamps in the log; the last bar holds all beyond.",
        size_in=(10.0, 2.8),
        draw=draw,
        tables={f"latency_{name}": {f"{name}_ms": values} for name, _, values in parts},
    )
