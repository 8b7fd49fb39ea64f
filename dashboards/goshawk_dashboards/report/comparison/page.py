"""The comparison's page."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape

from goshawk_dashboards.report.canvas import Figure
from goshawk_dashboards.report.comparison.data import CLASSICAL, Comparison, Pair
from goshawk_dashboards.report.comparison.latency import NOTE, latency_table, measured
from goshawk_dashboards.report.comparison.verdict import HEADS, facts, known, side_by_side, verdict
from goshawk_dashboards.report.shell import document, panel, table, tiles

CAVEATS = (
    "A metric goes to the pilot that is better in at least twice as many cells as the other. A pilot wins if a metric "
    "goes to it and none to the other.",
    "A cell's successes are decided only where the two 95 % intervals (Wilson) do not overlap. Other numbers that "
    "differ by 1 % or less are a tie. Where a pilot flew fewer than two flights, or fewer than two reached the goal, "
    "nothing is claimed.",
    "A place of 4 m is a forest with a tree every 4 m. A course is 40 m long where nothing else is said.",
    "Flights are the same on every machine whose processor rounds alike. Compute is of the machine that flew, and of "
    "its load.",
    "Compute is of a whole campaign, so it counts once for each, however many cells there are. A plan is what is done "
    "for one frame of the camera; the classical pilot makes a new trajectory in every third or when it must.",
    "In a chase the classical pilot finds the target by the learned pilot's network: that is its perception. The "
    "learned pilot's perception is its whole network, which plans too.",
    "A flight that ends early has had less time to jerk, and to come near anything.",
)

HASHES = "<p class='soft'>Of each SHA-256 its first 12 digits.</p>"
BETTER = "<b class='good'>{}</b>"


def page(comparison: Comparison, figures: Sequence[Figure]) -> str:
    """The whole page; byte for byte the same for the same files."""
    head, rest = verdict(comparison)
    measurements = f"{latency_table(measured(comparison))}<p class='soft'>{NOTE}</p>"
    parts = [
        f"<header><p class='soft'>Learned against classical</p><h1>{head}</h1><p class='lead'>{rest}</p></header>",
        "<h2 class='section'>Cells that the learned pilot wins–loses–ties</h2>",
        tiles(_tiles(comparison)),
        _cells(comparison),
        *(panel(figure, measurements if figure.name == "latency" else "") for figure in figures),
        _flown(comparison),
        f"<p class='lead'><b>{head}.</b> {rest}</p>",
    ]
    return document(f"{head}: learned against classical", parts)


def _tiles(comparison: Comparison) -> Iterator[tuple[str, str, str]]:
    for score in comparison.scores:
        name = f"{score.metric.name}, by campaign" if score.metric.of_campaign else score.metric.name
        yield name, f"{score.learned}–{score.classical}–{score.tied}", ""


def _cells(comparison: Comparison) -> str:
    metrics = known(comparison)

    def row(pair: Pair) -> Iterator[str]:
        yield from (f"<td>{escape(fact)}</td>" for fact in facts(pair))
        yield from (f"<td class='number'>{side_by_side(metric, pair, BETTER)}</td>" for metric in metrics)

    detail = {m: ", ".join(filter(None, (m.detail, m.unit))) for m in metrics}
    heads = [*HEADS, *(f"{m.name}<small>{detail[m]}</small>" for m in metrics)]
    body = table(heads, (row(pair) for pair in comparison.pairs), "cells pairs")
    note = "Learned / classical. Bold is the better one; a tie has none."
    return f"<section class='panel'><h2>Cell by cell</h2><p class='soft'>{note}</p>{body}</section>"


def _flown(comparison: Comparison) -> str:
    def row(place: int) -> Iterator[str]:
        campaign = comparison.campaigns[place]
        file, cells = campaign.file, campaign.file.cells
        flights = sum(cell.trials for cell in cells)
        paired = sum(pair.campaign is campaign for pair in comparison.pairs)
        hashes = ((sha or "")[:12] for sha in (file.policy_sha256, file.vehicle_sha256, file.flight_code_sha256))
        words = (f"{campaign.name}.json", f"{paired} of {sum(c.pilot != CLASSICAL for c in cells)}", f"{flights}")
        for word in (*words, f"{file.seed}", *hashes):
            yield f"<td>{escape(word or '–')}</td>"
        yield f"<td>{escape(file.version)}</td>"

    heads = ("file", "paired cells", "flights", "seed", "policy", "vehicle file", "flight code", "version")
    files = table(heads, (row(place) for place in range(len(comparison.campaigns))), "cells words")
    rules = dict.fromkeys(
        (c.file.cells[0].task, line) for c in comparison.campaigns for line in c.file.rule.splitlines()
    )
    rule = "".join(f"<li>{escape(task)}, {escape(line)}</li>" for task, line in rules)
    left = f"<p class='soft'>Left out: {escape(', '.join(comparison.skipped))}.</p>" if comparison.skipped else ""
    caveats = "".join(f"<li>{caveat}</li>" for caveat in CAVEATS)
    return (
        f"<section class='panel'><h2>What was flown</h2>{HASHES}{files}{left}</section>"
        f"<section class='panel'><h2>What a success is</h2><ul>{rule}</ul></section>"
        f"<section class='panel'><h2>How to read it</h2><ul>{caveats}</ul></section>"
    )
