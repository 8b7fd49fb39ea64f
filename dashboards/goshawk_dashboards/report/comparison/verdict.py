"""Who wins what, in words and as a table; both as Markdown, between the marks of a file."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from pathlib import Path

from goshawk_dashboards.report.campaign.data import CampaignError
from goshawk_dashboards.report.campaign.tables import NONE, number
from goshawk_dashboards.report.comparison.data import METRICS, WANTED, Comparison, Metric, Pair

MARKS = ("<!-- compare: begin -->", "<!-- compare: end -->")
HEADS = ("campaign", "asked, m/s", "place", "flights")


def verdict(comparison: Comparison) -> tuple[str, str]:
    """Who wins, without a full stop, and the sentences that say by what."""
    scores = comparison.scores
    learned, classical = ([s.metric.name for s in scores if s.winner == pilot] for pilot in ("learned", "classical"))
    if learned and classical:
        by = f"The learned one is better by {_and(learned)}, the classical one by {_and(classical)}."
        return "Neither pilot wins", " ".join([by, *_rest(comparison)])
    for name, won in (("learned", learned), ("classical", classical)):
        if won:
            by = f"It is better by {_and(won)}, the other by nothing."
            return f"The {name} pilot wins", " ".join([by, *_rest(comparison)])
    return "It is undecided which pilot wins", " ".join(["Neither is better by anything.", *_rest(comparison)])


def _rest(comparison: Comparison) -> Iterator[str]:
    flights = sum(side.cell.trials for pair in comparison.pairs for _, side in pair.sides)
    cells = len(comparison.pairs)
    yield f"Both flew {cells} {'cell' if cells == 1 else 'cells'} on the same seeds, {flights} flights together."
    counts = (
        f"{score.metric.name} {score.learned}–{score.classical}–{score.tied}"
        + (" (by campaign)" if score.metric.of_campaign else "")
        for score in comparison.scores
    )
    yield f"The learned pilot wins–loses–ties this many: {', '.join(counts) or 'none, with too few flights'}."
    if ratios := comparison.compute_ratios:
        least, most = (f"{ratio:.2f}" for ratio in (min(ratios), max(ratios)))
        what = least if least == most else f"{least} to {most}"
        met = "met" if max(ratios) <= WANTED else "missed"
        yield f"A plan costs it {what} of the classical pilot's compute; a third at most is wanted: {met}."


def _and(names: list[str]) -> str:
    return " and ".join(part for part in (", ".join(names[:-1]), names[-1]) if part)


def known(comparison: Comparison) -> list[Metric]:
    """The metrics that any pair has."""
    return [m for m in METRICS if any(m.value(side) is not None for pair in comparison.pairs for _, side in pair.sides)]


def side_by_side(metric: Metric, pair: Pair, marked: str) -> str:
    """Learned / classical; the better one is put into `marked`."""
    better = metric.better(pair)
    texts = [number(metric.value(side), metric.digits) for _, side in pair.sides]
    parts = [marked.format(text) if better == sign else text for text, sign in zip(texts, (1, -1), strict=True)]
    return NONE if texts == [NONE, NONE] else " / ".join(parts)


def facts(pair: Pair) -> tuple[str, ...]:
    """A line's first cells."""
    cell = pair.learned.cell
    return pair.campaign.name, f"{cell.speed_mps:g}", pair.place, f"{cell.trials}"


def markdown(comparison: Comparison, page: Path, file: Path) -> str:
    """The verdict, for a file that leads to the page."""
    head, rest = verdict(comparison)
    link = Path(os.path.relpath(page, file.parent)).as_posix()
    return f"**{head}.** {rest} [The whole comparison]({link})."


def markdown_table(comparison: Comparison) -> str:
    """A line for each pair: learned / classical, the better in bold."""
    metrics = known(comparison)
    heads = [*HEADS, *(", ".join(filter(None, (m.name, m.detail, m.unit))) for m in metrics)]

    def line(cells: Iterable[str]) -> str:
        return f"| {' | '.join(cells)} |"

    rows = (
        line([*facts(pair), *(side_by_side(metric, pair, "**{}**") for metric in metrics)]) for pair in comparison.pairs
    )
    return "\n".join([line(heads), "|---" * len(heads) + "|", *rows, "", "Each cell: learned / classical."])


def put(path: Path, text: str) -> None:
    """Replaces what stands between the marks of a Markdown file. Raises `CampaignError`: it has none; and OSError."""
    begin, end = MARKS
    whole = path.read_text(encoding="utf-8") if path.exists() else f"{begin}\n{end}\n"
    if whole.count(begin) != 1 or whole.count(end) != 1 or whole.index(end) < whole.index(begin):
        raise CampaignError(f"{path} lacks the marks {begin} and {end}")
    before, rest = whole.split(begin)
    path.write_text(f"{before}{begin}\n{text}\n{end}{rest.split(end)[1]}", encoding="utf-8")
