"""What lies over the whole window, wherever the panels are scrolled, folded or docked: Stop, alerts, the last command.

viser lays its panels out by itself. Two things of it are changed here, by a style sheet and a few lines of script that
its own HTML element carries, so nothing is fetched: the boxes of the buttons that follow a ``marker`` are pinned to the
window, and the stop key is passed on to viser's hotkeys even while an input field has the focus, where viser alone
would ignore it.
"""

from __future__ import annotations

from html import escape

from goshawk_dashboards import theme
from goshawk_dashboards.alerts import COMMAND_S, Alert
from goshawk_dashboards.snapshot import Snapshot

STOP, STOP_ALL = "stop-here", "stop-all-here"
NARROW = "@media (max-width: 576px)"
"""viser's own limit between docked panels and the sheet at the bottom."""

_KEY_SCRIPT = (
    "if(!window.goshawkKeys){window.goshawkKeys=1;"
    "for(const kind of ['keydown','keyup'])window.addEventListener(kind,e=>{"
    "if(e.code!=='Space'||!e.isTrusted)return;e.preventDefault();e.stopImmediatePropagation();"
    "if(kind==='keydown'&amp;&amp;!e.repeat)document.documentElement.dispatchEvent(new KeyboardEvent('keydown',"
    "{key:' ',code:'Space',shiftKey:e.shiftKey,bubbles:true}))},true)}"
)


def marker(place: str) -> str:
    """The button that follows this HTML is pinned at ``place``: STOP or STOP_ALL."""
    return f'<div data-goshawk="{place}"></div>'


def frame_html(fleet: bool) -> str:
    """The style sheet and the key script; sent once. ``fleet``: there is a second button, Stop all."""
    stop_left, stop_width = ("calc(50% - 156px)", "150px") if fleet else ("calc(50% - 120px)", "240px")
    return f"""<style>
{_box(STOP)}, {_box(STOP_ALL)} {{position: fixed; z-index: 40; bottom: 14px; margin: 0 !important;
  padding: 0 !important}}
{_box(STOP)} {{left: {stop_left}; width: {stop_width}}}
{_box(STOP_ALL)} {{left: calc(50% + 6px); width: 150px}}
{_box(STOP)} button, {_box(STOP_ALL)} button {{height: 48px !important; font-size: 17px; box-shadow: 0 2px 14px #000b}}
{_box(STOP)} button::after {{content: "space" / ""; position: absolute; top: 18px; right: 10px; opacity: .75;
  font: 11px system-ui}}
{_box(STOP_ALL)} button::after {{content: "shift+space" / ""; position: absolute; bottom: 2px; right: 0; left: 0;
  font: 10px system-ui; opacity: .75}}
div[style*="display: none"]:has([data-goshawk="{STOP}"]) {{
  display: block !important; height: 0 !important; visibility: visible !important; opacity: 1 !important}}
.goshawk-top {{position: fixed; z-index: 39; top: 12px; left: 50%; transform: translateX(-50%); pointer-events: none;
  width: max-content; max-width: max(300px, calc(100vw - 720px)); font: 600 15px/1.4 system-ui, sans-serif}}
.goshawk-toast {{position: fixed; z-index: 39; bottom: 70px; left: 50%; transform: translateX(-50%);
  pointer-events: none; width: max-content; max-width: max(300px, calc(100vw - 720px));
  font: 600 14px/1.4 system-ui, sans-serif}}
.goshawk-edge {{position: fixed; inset: 0; z-index: 38; pointer-events: none}}
.goshawk-pulse {{animation: goshawk-pulse 1s ease-in-out infinite alternate}}
@keyframes goshawk-pulse {{from {{opacity: 1}} to {{opacity: .55}}}}
.goshawk-tip {{display: none}}
.goshawk-hover:hover .goshawk-tip {{display: block}}
{NARROW} {{
  {_box(STOP)}, {_box(STOP_ALL)} {{bottom: auto; top: 8px}}
  {_box(STOP)} {{left: 8px; width: {"calc(50vw - 12px)" if fleet else "calc(100vw - 16px)"}}}
  {_box(STOP_ALL)} {{left: calc(50vw + 4px); width: calc(50vw - 12px)}}
  .mantine-Notifications-root {{margin-top: 56px}}
  .goshawk-top {{top: 64px; max-width: calc(100vw - 16px)}}
  .goshawk-toast {{bottom: auto; top: 64px; max-width: calc(100vw - 16px)}}
  .goshawk-top:has(.goshawk-alert) ~ .goshawk-toast {{display: none}}
}}
</style><img alt="" src="data:," style="display:none" onerror="{_KEY_SCRIPT}">"""


def _box(place: str) -> str:
    return f'div:has(> [data-goshawk="{place}"]) + div'


def overlay_html(snap: Snapshot, shown: list[tuple[str, Alert]]) -> str:
    """Alerts, each with the name of its vehicle (empty: the only one), the red edge, and the last command's outcome."""
    severe = any(alert.severe and not alert.over for _, alert in shown)
    edge = (
        f'<div data-goshawk="edge" class="goshawk-edge goshawk-pulse" '
        f'style="box-shadow:inset 0 0 0 6px {theme.css(theme.BAD)}"></div>'
        if severe
        else ""
    )
    lines = "".join(_alert(name, alert) for name, alert in shown)
    return f'{edge}<div data-goshawk="alerts" class="goshawk-top">{lines}</div>{_toast(snap)}{_dimmed(snap)}'


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
    if command is None or command.at_s is None or snap.now_s - command.at_s > COMMAND_S:
        return ""
    if command.pending:
        color = theme.WARN
        words = f"{command.verb}: waiting for the vehicle's reply, {snap.now_s - command.at_s:.1f} s"
    elif command.answered:
        color = theme.GOOD if command.accepted else theme.BAD
        took = "" if command.took_s is None else f" after {1e3 * command.took_s:.0f} ms"
        words = f"vehicle {'confirms' if command.accepted else 'refuses'} {command.verb}{took}: {command.text}"
    else:
        color, words = theme.BAD, f"{command.verb} NOT CONFIRMED: {command.text}"
    return (
        f'<div data-goshawk="toast" class="goshawk-toast" style="border-radius:8px;padding:5px 14px;color:#fff;'
        f'text-align:center;background:rgba(17,20,26,.92);border:1px solid {theme.css(color)}">'
        f'<span style="color:{theme.css(color)}">&#9679;</span> {escape(words)}</div>'
    )


def _dimmed(snap: Snapshot) -> str:
    """Plots and picture of a silent vehicle lose their colour: they show what was."""
    return "<style>.uplot, [data-goshawk=picture] {opacity:.35; filter:grayscale(1)}</style>" if snap.stale else ""
