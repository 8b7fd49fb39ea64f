"""The bridge between a ROS 2 world and a vehicle's end of the network, each on ports of its own."""

from __future__ import annotations

import tomllib
from collections import defaultdict
from pathlib import Path
from typing import Any

from goshawk_proto import goshawk_pb2 as pb
from goshawk_proto import key_expression
from rig import BIN, ROOT, Rig, free_port
from ros_peer import RosPeer, listening, until

SHIPPED = ROOT / "air/sensors/ros2/ros2.toml"
TOPICS: dict[str, Any] = tomllib.loads(SHIPPED.read_text())
VEHICLE = "goshawk"


class VehicleEnd:
    """What a vehicle has of the network: it listens, takes images and odometry, and tells."""

    def __init__(self, port: int) -> None:
        self.session = listening(port, "peer")
        self.images: list[pb.Rgbd] = []
        self.motions: list[pb.Odometry] = []
        self._told = {
            name: self.session.declare_publisher(key_expression(name, VEHICLE))
            for name in ("plan", "control", "target")
        }
        self.session.declare_subscriber(
            key_expression("rgbd", VEHICLE), lambda s: self.images.append(pb.Rgbd.FromString(s.payload.to_bytes()))
        )
        self.session.declare_subscriber(
            key_expression("odometry", VEHICLE),
            lambda s: self.motions.append(pb.Odometry.FromString(s.payload.to_bytes())),
        )

    def tell(self, name: str, message: pb.Plan | pb.Control | pb.Target) -> None:
        self._told[name].put(message.SerializeToString())

    def close(self) -> None:
        self.session.close()  # pyright: ignore[reportUnknownMemberType]


class BridgeRig:
    """A running bridge."""

    def __init__(self, folder: Path) -> None:
        self.rig = Rig(folder=folder)
        self.ros = RosPeer(free_port())

    def start(self, *changes: tuple[str, str]) -> None:
        """Starts the bridge by the shipped file with these changes, and waits until its node is seen."""
        text = SHIPPED.read_text()
        ends = [("tcp/127.0.0.1:7448", self.rig.endpoint), ("tcp/127.0.0.1:7447", self.ros.endpoint)]
        for old, new in [*ends, *changes]:
            assert old in text, old
            text = text.replace(old, new)
        config = self.rig.folder / "ros2.toml"
        config.write_text(text)
        self.rig.spawn("bridge", BIN / "goshawk-ros2", "--config", config)
        until(lambda: len(self.ends()) >= 2, self.said())

    def said(self) -> str:
        path = self.rig.folder / "bridge.out"
        return path.read_text(errors="replace") if path.exists() else ""

    def ends(self) -> dict[str, list[str]]:
        """The tokens of the bridge's node by their kind: NN, MP, MS."""
        found: dict[str, list[str]] = defaultdict(list)
        for token in self.ros.tokens:
            parts = token.split("/")
            if parts[8] == "goshawk_bridge":
                found[parts[5]].append(token)
        return found

    def close(self) -> None:
        self.rig.close()
        self.ros.close()
