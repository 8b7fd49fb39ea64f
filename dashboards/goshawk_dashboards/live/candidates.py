"""The candidates of a plan, beside the 3-D view: over the camera's picture, and as a strip ranked by cost.

What the mouse is over shows its figures by style alone, so the words may be replaced many times a second under it.
"""

from __future__ import annotations

import base64
from collections import Counter
from html import escape

import numpy as np
import viser.transforms as tf
from numpy.typing import NDArray

from goshawk_dashboards.page import theme
from goshawk_dashboards.page.candidates import ranked, reason, words_of
from goshawk_dashboards.scene import curves
from goshawk_dashboards.state import words
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_dashboards.state.views import Array, PlanView, PreviewView

HFOV_RAD = float(np.pi / 2.0)
"""Of the camera whose picture is shown: the lattice's."""
MAX_PREVIEW_BYTES = 200_000

_DIM = "#8b95a5"


def strip_html(snap: Snapshot, *, fresh: bool) -> str:
    """A bar a candidate, the one flown first, then by cost; below, in words, what is flown and why the rest is not."""
    plan = snap.plan
    if plan is None or len(plan.cost_N) == 0:
        return f'<div data-goshawk="strip" style="font:12px system-ui;color:{_DIM};padding:2px 8px">no plan yet</div>'
    top = max(float(plan.cost_N.max()), 1e-9)
    colors = [(int(r), int(g), int(b)) for r, g, b in curves.colors_N3(plan)]
    columns = "".join(
        _column(plan, k, 4.0 + 26.0 * max(0.0, float(plan.cost_N[k])) / top, colors[k]) for k in ranked(plan)
    )
    chosen = words_of(plan, plan.chosen) if plan.chosen is not None else "nothing was eligible: what there is, is held"
    others = Counter(reason(why) for k, why in enumerate(plan.rejections) if k != plan.chosen)
    faded = "" if fresh else "opacity:.35;filter:grayscale(1);"
    return (
        f'<div data-goshawk="strip" data-chosen="{"" if plan.chosen is None else plan.chosen}" '
        f'style="{faded}position:relative;padding:2px 8px 4px;font:12px/1.35 system-ui;color:{_DIM}">'
        f'<div style="display:flex;align-items:flex-end;gap:2px;height:32px">{columns}</div>'
        f'<div style="color:#fff;margin-top:3px">{escape(chosen)}</div>'
        f"<div>{escape('; '.join(f'{count} {why}' for why, count in others.most_common()))}</div></div>"
    )


def _column(plan: PlanView, k: int, height_px: float, color: theme.Rgb) -> str:
    return (
        f'<div class="goshawk-hover" data-candidate="{k}" data-rejection="{words.rejection(plan.rejections[k])}" '
        f'style="flex:1;min-width:0;cursor:help"><div style="height:{height_px:.0f}px;border-radius:2px;'
        f'background:{theme.css(color)};{"outline:2px solid #fff" if k == plan.chosen else ""}"></div>'
        f'<div class="goshawk-tip" style="position:absolute;left:0;right:0;top:36px;bottom:0;z-index:5;'
        f'background:#11141a;color:#fff;padding:2px 8px">{escape(words_of(plan, k))}</div></div>'
    )


def picture_html(snap: Snapshot, *, fresh: bool, altered: PlanView | None = None) -> str:
    """The camera's newest picture, and over it where the candidates lead, their detections and the filter's target.

    ``altered`` is another plan of the same frame, to be drawn over the first.
    """
    preview = snap.preview
    if preview is None or len(preview.picture) > MAX_PREVIEW_BYTES:
        return f'<div data-goshawk="picture" style="padding:8px;font:12px system-ui;color:{_DIM}">no picture yet</div>'
    age_s = snap.age_s("preview") or 0.0
    late = f"{age_s:.1f} s old" if age_s > 1.0 else ""
    drawn = _drawn(snap, preview, altered) if fresh and snap.plan is not None else ""
    # The vehicle's own bytes, as they came: nothing is decoded or encoded here.
    data = base64.b64encode(preview.picture).decode("ascii")
    return (
        f'<div data-goshawk="picture" style="position:relative;margin:6px 8px 2px;line-height:0">'
        f'<img alt="camera" src="data:image;base64,{data}" style="width:100%;image-rendering:pixelated">'
        f'<svg viewBox="0 0 {preview.width} {preview.height}" style="position:absolute;inset:0;width:100%;height:100%">'
        f"{drawn}</svg>"
        f'<div style="position:absolute;right:6px;top:10px;font:600 12px system-ui;color:#ff9">{late}</div></div>'
    )


def _drawn(snap: Snapshot, preview: PreviewView, altered: PlanView | None) -> str:
    plan = snap.plan
    if plan is None or len(plan.cost_N) == 0:
        return ""
    focal = 0.5 * preview.width / np.tan(0.5 * HFOV_RAD)
    world_from_cam_33 = tf.SO3(plan.world_from_cam_4).as_matrix()

    def project(points_M3: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Pixels and whether each is in front of the lens."""
        cam_M3 = (points_M3 - plan.start_pos_world_3) @ world_from_cam_33
        ahead_M = cam_M3[:, 0] > 0.3
        depth_M = np.where(ahead_M, cam_M3[:, 0], 1.0)
        u_M = 0.5 * preview.width - focal * cam_M3[:, 1] / depth_M
        v_M = 0.5 * preview.height - focal * cam_M3[:, 2] / depth_M
        return np.stack([u_M, v_M], axis=1), ahead_M

    colors = [(int(r), int(g), int(b)) for r, g, b in curves.colors_N3(plan)]
    curves_NS3 = curves.plan_curves_NS3(plan, 10)
    order = sorted(range(len(colors)), key=lambda k: k == plan.chosen)
    parts = [_path(plan, k, *project(curves_NS3[k, 2:]), colors[k]) for k in order]
    if altered is not None:
        ways = enumerate(curves.plan_curves_NS3(altered, 10)[:, 2:])
        over = "".join(_path(altered, k, *project(way_S3), theme.REPLAY) for k, way_S3 in ways)
        parts.append(f'<g data-goshawk="altered" opacity="0.8">{over}</g>')
    if plan.target_pos_world_N3 is not None:
        pixels_N2, ahead_N = project(plan.target_pos_world_N3)
        parts += [
            f'<circle cx="{u:.1f}" cy="{v:.1f}" r="2" fill="{theme.css(theme.TARGET)}" '
            f'opacity="{float(np.clip(plan.objectness_N[k], 0.0, 1.0)):.2f}"/>'
            for k, (u, v) in enumerate(pixels_N2)
            if ahead_N[k] and plan.objectness_N[k] > 0.1
        ]
    if snap.target is not None and snap.fresh("target"):
        (u, v), ahead = (x[0] for x in project(snap.target.pos_world_3[None]))
        if ahead:
            dash = "" if snap.target.confirmed else 'stroke-dasharray="2 2"'
            parts.append(
                f'<rect data-goshawk="estimate" x="{u - 6:.1f}" y="{v - 10:.1f}" width="12" height="20" fill="none" '
                f'stroke="{theme.css(theme.TARGET)}" stroke-width="1" {dash}/>'
            )
    return "".join(parts)


def _path(plan: PlanView, k: int, pixels_S2: Array, ahead_S: NDArray[np.bool_], color: theme.Rgb) -> str:
    flown = k == plan.chosen
    points = " ".join(f"{u:.1f},{v:.1f}" for (u, v), ahead in zip(pixels_S2, ahead_S, strict=True) if ahead)
    if not points:
        return ""
    line = f'points="{points}" fill="none" stroke-linecap="round"'
    return (
        f'<g class="goshawk-hover" data-candidate="{k}">'
        f'<polyline {line} stroke="{theme.css(color)}" stroke-width="{2.2 if flown else 0.9}" '
        f'opacity="{0.95 if flown else 0.75}"/>'
        f'<polyline {line} stroke="#000" stroke-opacity="0" stroke-width="5" pointer-events="stroke"/>'
        f'<text class="goshawk-tip" x="3" y="8" font-size="6" fill="#fff" stroke="#000" stroke-width="1.4" '
        f'paint-order="stroke" font-family="system-ui">{escape(words_of(plan, k))}</text></g>'
    )
