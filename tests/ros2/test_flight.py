"""ROS 2's odometry and images fly the demo: simulator, ROS 2 driver, bridge and vehicle, each a process or a peer."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest
from bridge_rig import TOPICS, VEHICLE, BridgeRig
from driver import Driver
from goshawk_proto import goshawk_pb2 as pb
from rig import BIN, copied
from ros_peer import Heard, until

FLYING = {pb.MODE_TRACK, pb.MODE_SEARCH, pb.MODE_HOLD}


@pytest.fixture
def driver(bridge: BridgeRig) -> Iterator[Driver]:
    """The ROS 2 driver, which is also between the simulator's autopilot and the vehicle."""
    driver = Driver(bridge.ros, TOPICS, VEHICLE, bridge.rig.mavlink_port)
    yield driver
    driver.close()


def away_m(heard: Heard, first: Any) -> float:
    pos = heard.message.pose.pose.position
    return math.hypot(pos.x - first.x, pos.y - first.y)


def test_ros2_odometry_and_images_fly_a_chase(bridge: BridgeRig, driver: Driver) -> None:
    rig = bridge.rig
    text = copied()
    assert 'odometry = "autopilot"' in text
    vehicle = rig.folder / "vehicle.toml"
    vehicle.write_text(text.replace('odometry = "autopilot"', 'odometry = "zenoh"'))
    bridge.ros.listen("/goshawk/odometry", "nav_msgs/msg/Odometry")
    bridge.ros.listen("/goshawk/plan", "nav_msgs/msg/Path")
    rig.air(vehicle=vehicle)
    # The vehicle's sensors are ROS 2's alone: the simulator dials the driver.
    rig.spawn(
        "sim", BIN / "goshawk-sim", "serve", "--connect", driver.endpoint, "--mavlink-port", str(driver.mavlink_port),
        "--seed", "3",
    )  # fmt: skip
    bridge.start()
    with rig.link() as link:
        ready = link.wait_for(lambda s: s.health is not None and s.health.ready, 40.0)
        assert ready is not None, rig.output("air") + bridge.said()
        assert link.start().accepted
        assert link.wait_for(lambda s: s.mode == pb.MODE_TRACK, 40.0) is not None, rig.output("air")
        heard = bridge.ros.heard["/goshawk/odometry"]
        first = heard[-1].message.pose.pose.position
        until(lambda: away_m(heard[-1], first) > 8.0, f"it does not fly: {heard[-1]}", 30.0)
        assert link.wait_for(lambda s: s.mode in FLYING, 5.0) is not None, rig.output("air")
    assert bridge.ros.heard["/goshawk/plan"]
    refused = [line for line in bridge.said().splitlines() if "refused" in line]
    assert not [line for line in refused if "no camera_info came yet" not in line], refused
