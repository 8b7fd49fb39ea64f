"""What decides between the candidates of a plan, in words and figures: cost, what the planner adds to it, and why each
is not flown. Pure; the live view and the review show the same."""

from __future__ import annotations

from html import escape

from goshawk_proto import goshawk_pb2 as pb

from goshawk_dashboards.page.html import DIM, NUM
from goshawk_dashboards.state import words
from goshawk_dashboards.state.views import ADDED, PlanView

REASONS: dict[pb.Rejection, str] = {
    pb.REJECTION_NONE: "flown",
    pb.REJECTION_COST: "dearer than the one flown",
    pb.REJECTION_OBJECTNESS: "no target to chase, and it holds none",
    pb.REJECTION_GATE: "its detection is not confirmed or not consistent",
    pb.REJECTION_BLOCKED: "cheaper alone: what is added decides",
    pb.REJECTION_INVALID: "its network values are not finite",
}
"""The words for each rejection."""


def reason(why: pb.Rejection) -> str:
    """The words of a rejection, known or not."""
    return REASONS.get(why, words.rejection(why))


def ranked(plan: PlanView) -> list[int]:
    """The one flown first, then by cost."""
    return sorted(range(len(plan.cost_N)), key=lambda k: (k != plan.chosen, float(plan.cost_N[k])))


def added_words(plan: PlanView, k: int) -> str:
    """What the planner adds to a candidate's cost, part by part: "+0.30 obstacle +0.12 target"; empty: nothing."""
    return " ".join(f"+{x:.2f} {part}" for part, x in zip(ADDED, plan.added_NP[k], strict=True) if x > 0.0)


def words_of(plan: PlanView, k: int) -> str:
    """All about one candidate, in a line."""
    cost = f"{plan.cost_N[k]:.2f} {added_words(plan, k)}".rstrip()
    return f"candidate {k + 1}: cost {cost}, objectness {plan.objectness_N[k]:.2f}, {reason(plan.rejections[k])}"


def table_html(plan: PlanView | None) -> str:
    """A row each: number, cost, what is added to it, and why it is not flown; None: there is no fresh plan."""
    if plan is None or len(plan.cost_N) == 0:
        return f'<div data-goshawk="parts" style="font:11px system-ui;{DIM};padding:2px 12px">no plan now</div>'
    rows = "".join(_row(plan, k) for k in ranked(plan))
    return (
        '<div data-goshawk="parts" style="font:11px/1.35 system-ui;color:#d7dde6;padding:2px 12px">'
        f'<table style="width:100%;border-spacing:6px 0"><tr style="{DIM}">'
        f'<td></td><td style="{NUM}">cost</td><td>added</td><td>why</td></tr>{rows}</table></div>'
    )


def _row(plan: PlanView, k: int) -> str:
    flown = ";font-weight:600;color:#fff" if k == plan.chosen else ""
    return (
        f'<tr data-candidate="{k}" style="vertical-align:top{flown}"><td style="{NUM}">{k + 1}</td>'
        f'<td style="{NUM}">{plan.cost_N[k]:.2f}</td><td>{added_words(plan, k)}</td>'
        f"<td>{escape(reason(plan.rejections[k]))}</td></tr>"
    )
