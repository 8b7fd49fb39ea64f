"""What lies over the whole window, wherever the panels are scrolled, folded or docked: Stop, alerts, the last command.

viser lays out its panels by itself, and what is in a folded one is not shown. So `overlay.js`, at the end of viser's
page, makes a layer beside viser's. Each new text comes as a template in an HTML element of viser's, where the script
finds it. Its buttons and the stop key go the way of viser's own hotkeys.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from html import escape
from importlib import resources

from goshawk_dashboards.page import theme
from goshawk_dashboards.state.alerts import COMMAND_S, Alert
from goshawk_dashboards.state.snapshot import Snapshot


def foot_html() -> str:
    """The layer itself: style and script, at the end of viser's page."""
    here = resources.files("goshawk_dashboards.live")
    style, script = (here.joinpath(name).read_text(encoding="utf-8") for name in ("overlay.css", "overlay.js"))
    return f"<style>\n{style}</style><script>\n{script}</script>"


@dataclass(frozen=True, kw_only=True)
class Stops:
    """What the buttons say; empty: the button is not there."""

    one: str = ""
    """Stops the vehicle shown; empty: this viewer commands nothing."""
    every: str = ""
    armed: bool = False
    """The next press of ``every`` stops all."""
    cancel: str = ""


def overlay_html(
    snap: Snapshot,
    shown: list[tuple[str, Alert]],
    *,
    stops: Stops,
    visit: str = "",
    vehicles: Sequence[str] = (),
) -> str:
    """Alerts, each with the name of its vehicle (empty: the only one), the red edge, the last command's outcome, and
    the buttons. Each second it is another text, by which the page knows that it is told anything at all.

    ``visit`` names this connection and ``vehicles`` are all there are: a page that is connected anew, where viser
    begins anew, asks for the vehicle that it showed before.
    """
    severe = any(alert.severe and not alert.over for _, alert in shown)
    edge = (
        f'<div data-goshawk="edge" class="goshawk-edge goshawk-pulse" '
        f'style="box-shadow:inset 0 0 0 6px {theme.css(theme.BAD)}"></div>'
        if severe
        else ""
    )
    lines = "".join(_alert(name, alert) for name, alert in shown)
    news = f'{edge}<div data-goshawk="alerts" class="goshawk-top">{lines}</div>{_toast(snap)}{_dimmed(snap)}'
    facts = {
        "stop": stops.one,
        "all": stops.every,
        "armed": str(stops.armed).lower(),
        "cancel": stops.cancel,
        "beat": f"{snap.now_s:.0f}",
        "visit": visit,
        "shown": snap.vehicle,
        "vehicles": " ".join(vehicles),
    }
    data = " ".join(f'data-{name}="{escape(value)}"' for name, value in facts.items())
    return f'<template data-goshawk="over" {data}>{news}</template>'


def phone_over_html(card: str) -> str:
    """A phone's card, apart from the rest: it is new with each picture, and Stop must not wait for one."""
    return f'<template data-goshawk="over-phone">{card}</template>' if card else ""


def _alert(name: str, alert: Alert) -> str:
    color = theme.STALE if alert.over else (theme.BAD if alert.severe else theme.WARN)
    ink = "#fff" if alert.severe or alert.over else "#201600"
    pulse = " goshawk-pulse" if alert.severe and not alert.over else ""
    words = f"{name}: {alert.text}" if name else alert.text
    return (
        f'<div class="goshawk-alert" data-severe="{str(alert.severe).lower()}" data-over="{str(alert.over).lower()}" '
        f'style="border-radius:8px;padding:6px 16px;margin-bottom:6px;text-align:center;color:{ink};'
        f'background:{theme.css(color, 0.94)};box-shadow:0 2px 14px #000b">'
        f'<span class="{pulse.strip()}">&#9888;</span> {escape(words)}{" (over)" if alert.over else ""}</div>'
    )


def _toast(snap: Snapshot) -> str:
    """The last command while it is news: waiting, or what the vehicle replied, and how long that took."""
    command = snap.command
    if command is None or command.at_s is None:
        return ""
    if snap.now_s - command.at_s - (command.took_s or 0.0) > COMMAND_S:
        return ""
    if command.pending:
        color = theme.WARN
        words = f"{command.verb}: waiting for the vehicle to reply, {snap.now_s - command.at_s:.1f} s"
    elif command.answered:
        color = theme.GOOD if command.accepted else theme.BAD
        took = "" if command.took_s is None else f" after {1e3 * command.took_s:.0f} ms"
        words = f"vehicle {'confirms' if command.accepted else 'refuses'} {command.verb}{took}: {command.text}"
    elif command.cancelled or command.refused_here:
        color = theme.WARN
        words = f"{command.verb} {'cancelled' if command.cancelled else 'not sent'}: {command.text}"
    else:
        color, words = theme.BAD, f"{command.verb} NOT CONFIRMED: {command.text}"
    return (
        f'<div data-goshawk="toast" class="goshawk-toast" style="border-radius:8px;padding:5px 14px;color:#fff;'
        f'text-align:center;background:rgba(17,20,26,.92);border:1px solid {theme.css(color)}">'
        f'<span style="color:{theme.css(color)}">&#9679;</span> {escape(words)}</div>'
    )


def _dimmed(snap: Snapshot) -> str:
    """Plots and picture of a silent vehicle lose their colour: they show what was."""
    return (
        "<style>[data-goshawk=charts], [data-goshawk=picture] {opacity:.35; filter:grayscale(1)}</style>"
        if snap.stale
        else ""
    )
