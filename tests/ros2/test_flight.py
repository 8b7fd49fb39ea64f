"""ROS 2's odometry and images fly the demo: simulator, ROS 2 driver, bridge and vehicle, each a process or a peer."""

from __future__ import annotations

import json
import math
import socket
import sys
from pathlib import Path
from typing import Any

import numpy as np
from bridge_rig import SHIPPED, VEHICLE, BridgeRig
from goshawk_proto import goshawk_pb2 as pb
from pymavlink.dialects.v20 import common as mavlink
from rig import BIN, copied, free_port
from ros_peer import Heard, until
from scipy.spatial.transform import Rotation

DRIVER = Path(__file__).with_name("driver.py")
FLYING = {pb.MODE_TRACK, pb.MODE_SEARCH, pb.MODE_HOLD}


def away_m(heard: Heard, first: Any) -> float:
    pos = heard.message.pose.pose.position
    return math.hypot(pos.x - first.x, pos.y - first.y)


def is_sent_on(heard: dict[str, Any]) -> None:
    """What went from the autopilot by ROS 2, bridge and vehicle came back to it as it was, its velocity in the body."""
    sent = heard["sent_on"][-1]
    assert (sent["frame_id"], sent["child_frame_id"], sent["estimator_type"], sent["component"]) == (
        mavlink.MAV_FRAME_LOCAL_NED, mavlink.MAV_FRAME_BODY_FRD, mavlink.MAV_ESTIMATOR_TYPE_VIO, 191,
    )  # fmt: skip

    def of(message: dict[str, Any], *names: str) -> list[float]:
        return [message[name] for name in names]

    estimates = [e for e in heard["estimates"] if np.allclose(of(e, *"xyz"), of(sent, *"xyz"), atol=1e-5)]
    [was] = estimates[-1:]
    assert np.isclose(abs(np.dot(was["q"], sent["q"])), 1.0, atol=1e-6)
    w, x, y, z = was["q"]
    velocity, rates = ("vx", "vy", "vz"), ("rollspeed", "pitchspeed", "yawspeed")
    vel_body = Rotation.from_quat([x, y, z, w]).inv().apply(of(was, *velocity))
    assert np.allclose(vel_body, of(sent, *velocity), atol=1e-4)
    assert np.allclose(of(was, *rates), of(sent, *rates), atol=1e-5)


def test_ros2_odometry_and_images_fly_a_chase(bridge: BridgeRig) -> None:
    rig = bridge.rig
    images, autopilot, told = free_port(), free_port(socket.SOCK_DGRAM), rig.folder / "odometry.json"
    driver = rig.spawn(
        "driver", sys.executable, DRIVER, "--router", bridge.ros.endpoint, "--topics", SHIPPED, "--vehicle", VEHICLE,
        "--port", str(images), "--mavlink", str(autopilot), str(rig.mavlink_port), "--heard", told,
    )  # fmt: skip
    until(lambda: "ready" in rig.output("driver"), "no driver")
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
        "sim", BIN / "goshawk-sim", "serve", "--connect", f"tcp/127.0.0.1:{images}", "--mavlink-port", str(autopilot),
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
    driver.terminate()
    assert driver.wait(20.0) == 0, rig.output("driver")
    is_sent_on(json.loads(told.read_text()))
    # On a machine that has other work, the first images come before their lens, and some come late.
    refused = [line for line in bridge.said().splitlines() if "refused" in line]
    expected = ("no camera_info came yet", "s old by this computer's clock")
    assert not [line for line in refused if not any(words in line for words in expected)], refused
