"""What decides between the candidates stands in live view and review alike: cost, what is added, and why in words."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import cast

import pytest
from goshawk_dashboards.instruments.track import Track
from goshawk_dashboards.live.candidates import strip_html
from goshawk_dashboards.live.feed import Words
from goshawk_dashboards.page.candidates import REASONS, added_words, reason, table_html
from goshawk_dashboards.review.tables import candidates_html
from goshawk_dashboards.state import decode
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_proto import goshawk_pb2 as pb
from made_up import make_plan

Make = Callable[..., Snapshot]


def rows(html: str) -> dict[int, list[str]]:
    """The table's cells by candidate, counted from 0."""
    found = re.findall(r'<tr data-candidate="(\d+)"[^>]*>(.*?)</tr>', html)
    return {int(k): re.findall(r"<td[^>]*>(.*?)</td>", cells) for k, cells in found}


def test_each_part_that_is_added_comes_off_the_wire_by_its_name() -> None:
    plan = pb.Plan(duration_s=1.5, world_from_cam=pb.Quat(w=1.0))
    plan.candidates.add(added_obstacle=0.25, added_mover=0.5, added_target=0.75, added_climbing=1.0)
    plan.candidates.add()
    seen = decode.plan(plan)
    assert added_words(seen, 0) == "+0.25 obstacle +0.50 mover +0.75 target +1.00 climbing"
    assert added_words(seen, 1) == ""
    plan.candidates[1].added_mover = float("nan")
    with pytest.raises(decode.MalformedError, match="added to a cost is not finite"):
        decode.plan(plan)


def test_every_rejection_has_words_and_an_unknown_one_its_number() -> None:
    assert set(REASONS) == set(pb.Rejection.values())
    assert reason(cast("pb.Rejection", 99)) == "99"


def test_the_table_has_cost_parts_and_reason_the_flown_first_then_by_cost() -> None:
    table = rows(table_html(make_plan(chosen=7)))
    assert list(table) == [7, *(k for k in range(15) if k != 7)]
    assert table[7] == ["8", "2.00", "", "flown"]
    assert table[6] == ["7", "1.86", "+0.30 obstacle +0.12 target", "dearer than the one flown"]
    assert table[0] == ["1", "1.00", "", "no target to chase, and it holds none"]
    assert "no plan" in table_html(None)


def test_live_view_and_review_show_the_same_table(snap: Make) -> None:
    table = table_html(make_plan())
    assert Words(snap(), Track(), None).candidates == table
    assert table in candidates_html(make_plan(), 5, None)
    assert "no plan" in Words(snap(age_s=5.0), Track(), None).candidates


def test_strip_and_cells_tell_the_parts_where_the_mouse_is(snap: Make) -> None:
    words = "candidate 7: cost 1.86 +0.30 obstacle +0.12 target, objectness 1.00, dearer than the one flown"
    assert words in strip_html(snap(), fresh=True)
    assert words in candidates_html(make_plan(), 5, None)
