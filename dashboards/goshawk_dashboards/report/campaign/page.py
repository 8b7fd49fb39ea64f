"""A campaign's page."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from html import escape

import numpy as np

from goshawk_dashboards.exports.drawing import speed_colors_P3
from goshawk_dashboards.report.campaign import tables
from goshawk_dashboards.report.campaign.data import OUTCOMES, Campaign, Cell
from goshawk_dashboards.report.campaign.report import CampaignReport, Shown
from goshawk_dashboards.report.campaign.tables import number
from goshawk_dashboards.report.canvas import Figure, svg
from goshawk_dashboards.report.shell import document, panel, table, tiles

WHY = (
    "collided", "lost the target", "ran out of time", "came too close to the target", "fell behind it",
    "had it in view too little", "flew too slowly",
)  # fmt: skip
"""The outcomes that are no success, in words."""
Z = 1.96
"""Of a 95 % interval."""


def page(report: CampaignReport) -> str:
    """The whole page."""
    campaign = report.campaign
    successes, trials = _totals(campaign)
    parts = [
        _head(campaign),
        tiles(_numbers(campaign)),
        _grid(panel(figure) for figure in report.outcomes),
        f"<section class='panel'><h2>Cells</h2>{tables.html(campaign)}</section>",
        panel(report.view) if report.view is not None else "",
        _distributions(report.distributions),
        *_flights(report),
        _facts(campaign),
    ]
    return document(f"{successes} of {trials}: {_what(campaign)}", parts)


def _grid(panels: Iterator[str]) -> str:
    return f"<div class='grid'>{''.join(panels)}</div>"


def _totals(campaign: Campaign) -> tuple[int, int]:
    cells = campaign.file.cells
    return sum(cell.successes for cell in cells), sum(cell.trials for cell in cells)


def wilson(successes: int, trials: int) -> tuple[float, float]:
    """The 95 % interval of a rate."""
    if trials == 0:
        return 0.0, 1.0
    p, square = successes / trials, Z * Z / trials
    middle = (p + square / 2) / (1 + square)
    half = (square * (p * (1 - p) + square / 4)) ** 0.5 / (1 + square)
    return max(middle - half, 0.0), min(middle + half, 1.0)


def _what(campaign: Campaign) -> str:
    """ "track · forest · 3, 5 m/s, a tree every 4 m"."""
    cells = campaign.file.cells

    def listed(read: Callable[[Cell], float]) -> str:
        return ", ".join(f"{value:g}" for value in sorted({read(cell) for cell in cells}))

    worlds = ", ".join(dict.fromkeys(cell.world for cell in cells))
    words = [f"{listed(lambda c: c.speed_mps)} m/s"]
    if any(cell.world == "forest" for cell in cells):
        words.append(f"a tree every {listed(lambda c: c.spacing_m)} m")
    if any(cell.moving for cell in cells):
        moving = listed(lambda c: c.moving)
        words.append(f"{moving} moving obstacle{'' if moving == '1' else 's'}")
    if any(cell.wind_mps for cell in cells):
        words.append(f"gusts to {listed(lambda c: c.wind_mps)} m/s")
    flew = list(dict.fromkeys(cell.pilot for cell in cells))
    pilots = [f"{' and '.join(flew)} pilot"] if flew != ["policy"] else []
    tasks = dict.fromkeys(cell.task for cell in cells)
    return " · ".join([*tasks, *pilots, worlds, ", ".join(words)])


def _head(campaign: Campaign) -> str:
    successes, trials = _totals(campaign)
    low, high = wilson(successes, trials)
    counts = [sum(cell.count(outcome) for cell in campaign.file.cells) for outcome in OUTCOMES[1:]]
    why = ", ".join(f"{count} {words}" for count, words in zip(counts, WHY, strict=True) if count) or "none failed"
    known = [cell.reached for cell in campaign.file.cells if cell.reached is not None]
    lax = f" By the lax rule {sum(known)} reached their end." if known else ""
    return (
        f"<header><p class='soft'>{escape(campaign.name)}: {escape(_what(campaign))}</p>"
        f"<h1>{successes} of {trials} flights succeeded</h1>"
        f"<p class='soft'>95 % interval {100.0 * low:.0f}–{100.0 * high:.0f} %; {why}.{lax}</p></header>"
    )


def _numbers(campaign: Campaign) -> Iterator[tuple[str, str, str]]:
    """Name, value and unit of all that is known."""
    flights = [flight for pool in campaign.pools for flight in pool.cell.flights]
    seen = [flight.in_view_fraction for flight in flights if flight.in_view_fraction is not None]
    near_m = [max(flight.clearance_m, 0.0) for flight in flights if flight.clearance_m is not None]
    samples = {name: np.concatenate([pool.samples[name] for pool in campaign.pools]) for name in ("distance", "speed")}
    if seen:
        yield "of the time in view, mean of the flights", f"{100.0 * float(np.mean(seen)):.0f}", "%"
    if len(samples["distance"]):
        yield "median distance to the target", f"{np.median(samples['distance']):.1f}", "m"
    if near_m:
        yield "median closest approach", f"{np.median(near_m):.2f}", "m"
        yield "closest of all", f"{min(near_m):.2f}", "m"
    if len(samples["speed"]):
        yield "median speed", f"{np.median(samples['speed']):.1f}", "m/s"
    if flights:
        yield "highest speed", f"{max(flight.flown_speed_mps.max for flight in flights):.1f}", "m/s"


def _distributions(figures: Sequence[Figure]) -> str:
    if not figures:
        return ""
    note = "Thin bar: 5 to 95 %. Thick bar: 25 to 75 %. Ring: median."
    panels = (panel(figure, _values(figure)) for figure in figures)
    return f"<h2 class='section'>Distributions</h2><p class='soft'>{note}</p>{_grid(panels)}"


def _values(figure: Figure) -> str:
    """The figure's numbers, to unfold."""
    columns = figure.tables[figure.name]
    places = [name for name in columns if name.startswith("p")]

    def row(k: int) -> Iterator[str]:
        yield f"<td class='number'>{columns['cell'][k]}</td><td class='number'>{columns['values'][k]}</td>"
        for name in places:
            value = columns[name][k]
            yield f"<td class='number'>{number(None if np.isnan(value) else float(value))}</td>"

    heads = ["cell", "values", *(f"{name[1:]} %" for name in places)]
    body = table(heads, (row(k) for k in range(len(columns["cell"]))))
    return f"<details><summary>Numbers, {escape(columns['unit'][0])}</summary>{body}</details>"


def _flights(report: CampaignReport) -> Iterator[str]:
    if not (report.failed or report.succeeded):
        return
    yield "<h2 class='section'>Flights</h2>"
    if report.top_mps > 0.0:
        yield _key(report)
    for title, flights in (("Failures", report.failed), ("First successes", report.succeeded)):
        if flights:
            yield f"<h3>{title}</h3>{_grid(_flight(report.campaign, shown) for shown in flights)}"
        if flights is report.failed and report.more:
            yield f"<p class='soft'>{len(report.more)} more failed: {', '.join(report.more)}.</p>"


def _key(report: CampaignReport) -> str:
    stops = speed_colors_P3(np.linspace(0.0, 1.0, 9), 1.0)
    shades = ", ".join(f"rgb({r} {g} {b})" for r, g, b in stops.tolist())
    target = (
        "The plain line is the target's, dotted where the camera did not see it. Faint lines join the two every 2 s. "
        if report.campaign.tracks
        else ""
    )
    bar = f"<i style='background:linear-gradient(90deg, {shades})'></i>"
    return (
        "<p class='soft key'>From above. The vehicle's path by its speed: "
        f"<span class='shades'>0 {bar} {report.top_mps:.1f} m/s</span>. {target}"
        "Open ring: the start. Disc: the target at the end, or the goal. "
        "The end: a tick for success, a cross for a collision, a ring for lost, a bar for a timeout, "
        "two rings for too close, a square for behind, a triangle for out of view, a diamond for slow. "
        "Obstacles are cut at the flight's height, after a collision at that of the contact.</p>"
    )


def _flight(campaign: Campaign, shown: Shown) -> str:
    pool, row = shown.pool, shown.row
    facts = [f"{row.flown_s:.1f} s"]
    if row.clearance_m is not None:
        facts.append(f"closest {max(row.clearance_m, 0.0):.2f} m")
    if row.in_view_fraction is not None:
        facts.append(f"in view {100.0 * row.in_view_fraction:.0f} %")
    facts += [f"{row.end_distance_m:.1f} m away at the end", f"mean {row.flown_speed_mps.mean:.1f} m/s"]
    drawn = svg(shown.map) if shown.map is not None else ""
    words = " · ".join(escape(fact).replace(" ", "&nbsp;") for fact in facts)
    modes = "".join(f"<li>{escape(mode)}</li>" for mode in row.modes)
    name = f"{pool.number}:{row.trial} · {escape(pool.label)} ·"
    return (
        f"<figure class='panel flight'><h4>{name} <b class='{row.outcome}'>{escape(row.ending)}</b></h4>"
        f"{drawn}<p class='soft'>{words}</p>{_code(campaign.again(pool, row.trial))}"
        f"<details><summary>Changes of mode</summary><ul>{modes}</ul></details></figure>"
    )


def _code(command: str) -> str:
    """A command, broken between its words only."""
    words = " ".join(f"<span>{escape(word)}</span>" for word in command.split(" "))
    return f"<code>{words}</code>" if command else ""


def _facts(campaign: Campaign) -> str:
    file = campaign.file
    facts = {
        "campaign": _code(file.command) or "unknown command",
        "seed": str(file.seed),
        "vehicle": escape(file.vehicle),
        "policy": f"SHA-256 {escape(file.policy_sha256)}" if file.policy_sha256 else "none",
        "height": f"{file.height_m:g} m above the start",
        "version": escape(file.version) or "unknown",
    }
    if file.rule:
        facts["rule"] = "<br>".join(escape(line) for line in file.rule.splitlines())
    if campaign.tracks:
        facts["desired speed"] = f"the target's and {file.speed_margin_mps:g} m/s"
    rows = "".join(f"<dt>{name}</dt><dd>{value}</dd>" for name, value in facts.items())
    numbers = _code(f"goshawk campaign report {campaign.name}.json --figures DIR")
    return (
        f"<section class='panel'><h2>What was flown</h2><dl>{rows}</dl></section>"
        f"<footer>All numbers as CSV: {numbers}</footer>"
    )
