"""Which vehicles and radios the command line names."""

from __future__ import annotations

import pytest
from goshawk_ground.link import LinkError
from goshawk_ground.link.fleet import places, radio_sources


def test_a_name_alone_is_at_the_common_endpoint() -> None:
    assert places(["a", "b@tcp/h:2"], "tcp/h:1") == {"a": "tcp/h:1", "b": "tcp/h:2"}


def test_a_name_given_twice_is_refused() -> None:
    with pytest.raises(LinkError, match="twice"):
        places(["a", "a@tcp/h:2"], "tcp/h:1")


def test_a_radio_without_a_name_is_the_first_vehicles() -> None:
    assert radio_sources(["udpin:0.0.0.0:1", "b@udpin:0.0.0.0:2"], ["a", "b"]) == {
        "a": "udpin:0.0.0.0:1",
        "b": "udpin:0.0.0.0:2",
    }


@pytest.mark.parametrize(("words", "why"), [(["c@udpin:0.0.0.0:1"], "no vehicle 'c'"), (["x", "y"], "two radios")])
def test_a_radio_that_fits_no_vehicle_is_refused(words: list[str], why: str) -> None:
    with pytest.raises(LinkError, match=why):
        radio_sources(words, ["a", "b"])
