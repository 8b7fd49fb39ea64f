"""The layout for Foxglove and Lichtblick names only what the export holds."""

from __future__ import annotations

import json
from collections.abc import Callable
from typing import Any

import pytest
from goshawk_dashboards.exports import FOXGLOVE_LAYOUT, Exported, Format
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory

LAYOUT = json.loads(FOXGLOVE_LAYOUT.read_text(encoding="utf-8"))
PANELS: dict[str, dict[str, Any]] = LAYOUT["configById"]
KINDS = {
    "/scene": "foxglove.SceneUpdate",
    "/camera/image": "foxglove.CompressedImage",
    "/camera/depth": "foxglove.RawImage",
    "/camera/calibration": "foxglove.CameraCalibration",
    "/log": "foxglove.Log",
    "/remembered": "foxglove.PointCloud",
}


@pytest.fixture(scope="module")
def newest(exported: Callable[[Format], Exported]) -> dict[str, Any]:
    """Topic → its last message."""
    with exported(Format.FOXGLOVE).path.open("rb") as file:
        reader = make_reader(file, decoder_factories=[DecoderFactory()])
        return {channel.topic: message for _, channel, _, message in reader.iter_decoded_messages()}


def panels(kind: str) -> list[dict[str, Any]]:
    return [config for name, config in PANELS.items() if name.startswith(f"{kind}!")]


def test_every_panel_is_placed_once() -> None:
    def leaves(node: Any) -> list[str]:
        return [node] if isinstance(node, str) else leaves(node["first"]) + leaves(node["second"])

    assert sorted(leaves(LAYOUT["layout"])) == sorted(PANELS)


def test_every_message_path_leads_to_a_number_or_a_state(newest: dict[str, Any]) -> None:
    paths = [p["value"] for kind in ("Plot", "StateTransitions") for panel in panels(kind) for p in panel["paths"]]
    assert len(paths) > 10
    for path in paths:
        topic, *fields = path.split(".")
        value = newest[topic]
        for field in fields:
            assert field in value.DESCRIPTOR.fields_by_name, path
            value = getattr(value, field)
        assert isinstance(value, int | float), path


def test_every_topic_exists_with_the_schema_that_its_panel_reads(newest: dict[str, Any]) -> None:
    (scene,) = panels("3D")
    topics = [*scene["topics"], *(panel["topicToRender"] for panel in panels("RosOut"))]
    for panel in panels("Image"):
        topics += [panel["imageMode"]["imageTopic"], panel["imageMode"]["calibrationTopic"]]
    for topic in topics:
        (kind,) = (name for prefix, name in KINDS.items() if topic.startswith(prefix))
        assert newest[topic].DESCRIPTOR.full_name == kind


def test_the_scene_follows_a_frame_that_moves_in_the_world(newest: dict[str, Any]) -> None:
    (scene,) = panels("3D")
    transform = newest["/tf"]
    assert (transform.parent_frame_id, transform.child_frame_id) == ("world", scene["followTf"])
    assert scene["layers"]["grid"]["frameId"] == "world"
