"""ROS 2's odometry and images fly the demo: simulator, ROS 2 driver, bridge and vehicle, each a process or a peer."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from bridge_rig import TOPICS, VEHICLE, BridgeRig
from driver import Driver
from goshawk_proto import goshawk_pb2 as pb
from pymavlink.dialects.v20 import common as mavlink
from rig import BIN, copied
from ros_peer import Heard
from scipy.spatial.transform import Rotation

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


def is_sent_on(driver: Driver) -> None:
    """What went from the autopilot by ROS 2, bridge and vehicle came back to it as it was, its velocity in the body."""
    sent = driver.sent_on[-1]
    assert (sent.frame_id, sent.child_frame_id, sent.estimator_type) == (
        mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD, mavlink.MAV_ESTIMATOR_TYPE_VIO,
    )  # fmt: skip
    assert sent.get_srcComponent() == 191
    [was] = [e for e in driver.estimates if np.allclose([e.x, e.y, e.z], [sent.x, sent.y, sent.z], atol=1e-5)][-1:]
    assert np.isclose(abs(np.dot(was.q, sent.q)), 1.0, atol=1e-6)
    w, x, y, z = was.q
    vel_body = Rotation.from_quat([x, y, z, w]).inv().apply([was.vx, was.vy, was.vz])
    assert np.allclose(vel_body, [sent.vx, sent.vy, sent.vz], atol=1e-4)
    rates = [[m.rollspeed, m.pitchspeed, m.yawspeed] for m in (was, sent)]
    assert np.allclose(*rates, atol=1e-5)


def test_ros2_odometry_and_images_fly_a_chase(bridge: BridgeRig, driver: Driver) -> None:
    rig = bridge.rig
    text = copied()
    assert 'odometry = "autopilot"' in text
    vehicle = rig.folder / "vehicle.toml"
    text = text.replace('odometry = "autopilot"', 'odometry = "zenoh"')
    vehicle.write_text(text.replace('firmware = "px4"', 'firmware = "px4"\nvision = "odometry"'))
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
        far = link.wait_for(lambda _: away_m(heard[-1], first) > 4.0, 60.0)
        assert far is not None, f"{away_m(heard[-1], first):.1f} m flown\n" + rig.output("air") + bridge.said()
        assert link.wait_for(lambda s: s.mode in FLYING, 5.0) is not None, rig.output("air")
    assert bridge.ros.heard["/goshawk/plan"]
    is_sent_on(driver)
    # On a machine that has other work, the first images come before their lens, and some come late.
    refused = [line for line in bridge.said().splitlines() if "refused" in line]
    expected = ("no camera_info came yet", "s old by this computer's clock")
    assert not [line for line in refused if not any(words in line for words in expected)], refused
