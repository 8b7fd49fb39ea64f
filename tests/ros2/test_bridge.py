"""The bridge as a process between rosbags' messages on rmw_zenoh's keys and a vehicle's end of the network."""

from __future__ import annotations

import io
import itertools
import math
import re
import signal
import struct
import subprocess
import threading
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from bridge_rig import SHIPPED, TOPICS, BridgeRig, VehicleEnd
from goshawk_ground.keys.chosen import demo_identities
from goshawk_proto import goshawk_pb2 as pb
from pictures import FOCAL_PX, HEIGHT, WIDTH, camera_info, compressed, image, odometry
from PIL import Image
from rig import BIN, ROOT, copied
from ros_peer import HUMBLE, STORE, RosPeer, new, until

COLOUR, DEPTH, INFO = (TOPICS["camera"][name] for name in ("colour", "depth", "info"))
ODOMETRY = TOPICS["odometry"]["topic"]
IMAGE, CAMERA_INFO = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
COMPRESSED, MOTION = "sensor_msgs/msg/CompressedImage", "nav_msgs/msg/Odometry"
LEVEL = (0.0, 0.0, 0.0, 1.0)


def colours() -> np.ndarray:
    """Red grows to the right, green downwards."""
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH]
    return np.stack([columns * 255 // WIDTH, rows * 255 // HEIGHT, np.full_like(rows, 40)], axis=2).astype(np.uint8)


def depths_mm() -> np.ndarray:
    """A wall that leans away to the right."""
    return np.tile(2000 + 5 * np.arange(WIDTH), (HEIGHT, 1)).astype("<u2")


def until_sent(send: Callable[[], None], arrived: Callable[[], object], bridge: BridgeRig) -> None:
    """Sends ten times a second until it has arrived: what is sent before the network stands is lost."""

    def once() -> object:
        send()
        time.sleep(0.1)
        return arrived()

    until(once, bridge.said())


def send_images(bridge: BridgeRig, type_hash: str | None = None) -> None:
    now = time.time_ns()
    bridge.ros.publish(INFO, CAMERA_INFO, camera_info(now), type_hash=type_hash)
    bridge.ros.publish(COLOUR, IMAGE, image(now, "bgr8", colours()[..., ::-1]), type_hash=type_hash)
    bridge.ros.publish(DEPTH, IMAGE, image(now + 2_000_000, "16UC1", depths_mm()), type_hash=type_hash)


def is_the_picture(sent: pb.Rgbd) -> None:
    """The two ramps, and both halves of the same pixels."""
    rgb = np.frombuffer(sent.rgb, np.uint8).reshape(sent.height, sent.width, 3).astype(float)
    depth = np.frombuffer(sent.depth_mm, "<u2").reshape(sent.height, sent.width).astype(float)
    column, row = np.arange(sent.width) + 0.5, np.arange(sent.height) + 0.5
    assert np.abs(rgb[..., 0] - 255 * column / sent.width).max() < 5
    assert np.abs(rgb[..., 1] - (255 * row / sent.height)[:, None]).max() < 5
    assert np.abs(rgb[..., 2] - 40).max() < 5
    assert np.abs(depth - (2000 + 5 * WIDTH * column / sent.width)).max() < 10


def test_images_come_to_the_vehicle_in_the_policys_view(bridge: BridgeRig, vehicle: VehicleEnd) -> None:
    bridge.start()
    until_sent(lambda: send_images(bridge), lambda: vehicle.images, bridge)
    sent = vehicle.images[-1]
    assert (sent.width, sent.height) == (320, 192)
    assert math.isclose(math.degrees(sent.hfov_rad), 90.0) and math.isclose(math.degrees(sent.vfov_rad), 61.93)
    assert 0 <= time.monotonic_ns() - sent.stamp_ns < 2e9
    is_the_picture(sent)


def test_humble_which_has_no_type_hashes_is_heard_too(bridge: BridgeRig, vehicle: VehicleEnd) -> None:
    bridge.start(("type_hashes = true", "type_hashes = false"))
    until_sent(lambda: send_images(bridge, HUMBLE), lambda: vehicle.images, bridge)
    is_the_picture(vehicle.images[-1])
    assert all(f"/{HUMBLE}/" in token for token in bridge.ends()["MP"])


def test_lyrical_whose_images_come_on_keys_of_their_own_is_heard_and_nothing_twice(
    bridge: BridgeRig, vehicle: VehicleEnd
) -> None:
    bridge.start()
    sent = 0

    def send() -> None:
        nonlocal sent
        now, sent = time.time_ns(), sent + 1
        bridge.ros.publish(INFO, CAMERA_INFO, camera_info(now))
        bridge.ros.publish_buffered(COLOUR, IMAGE, image(now, "rgb8", colours()))
        bridge.ros.publish_buffered(DEPTH, IMAGE, image(now + 2_000_000, "16UC1", depths_mm()))

    until_sent(send, lambda: len(vehicle.images) >= 5, bridge)
    is_the_picture(vehicle.images[-1])
    stamps = [picture.stamp_ns for picture in vehicle.images]
    assert len(set(stamps)) == len(stamps) <= sent


def test_compressed_images_come_to_the_vehicle(bridge: BridgeRig, vehicle: VehicleEnd) -> None:
    colour, depth = COLOUR + "/compressed", DEPTH + "/compressedDepth"
    bridge.start((f'"{COLOUR}"', f'"{colour}"'), (f'"{DEPTH}"', f'"{depth}"'))

    def file(picture: Image.Image, kind: str) -> bytes:
        out = io.BytesIO()
        picture.save(out, kind, quality=95)
        return out.getvalue()

    jpeg = file(Image.fromarray(colours()), "JPEG")
    png = bytes(12) + file(Image.fromarray(depths_mm()), "PNG")

    def send() -> None:
        now = time.time_ns()
        bridge.ros.publish(INFO, CAMERA_INFO, camera_info(now))
        bridge.ros.publish(colour, COMPRESSED, compressed(now, "rgb8; jpeg compressed bgr8", jpeg))
        bridge.ros.publish(depth, COMPRESSED, compressed(now, "16UC1; compressedDepth png", png))

    until_sent(send, lambda: vehicle.images, bridge)
    is_the_picture(vehicle.images[-1])


@pytest.mark.parametrize("little", [True, False], ids=["little endian", "big endian"])
def test_odometry_comes_to_the_vehicle_in_its_frames(bridge: BridgeRig, vehicle: VehicleEnd, little: bool) -> None:
    bridge.start(("yaw_deg = 0.0", "yaw_deg = 90.0"))
    turned = (0.0, 0.0, math.sqrt(0.5), math.sqrt(0.5))
    stamps: list[int] = []

    def send() -> None:
        stamps.append(time.time_ns())
        message = odometry(stamps[-1], (1, 2, 3), turned, (2, 0, 0.5), (0.1, 0.2, 0.3))
        bridge.ros.publish(ODOMETRY, MOTION, message, little=little)

    until_sent(send, lambda: vehicle.motions, bridge)
    sent = vehicle.motions[-1]
    # Its frame's x axis points north, and the body is turned by 90 degrees more: to the west.
    assert np.allclose([sent.pos_world.x, sent.pos_world.y, sent.pos_world.z], [-2, 1, 3])
    assert np.allclose([sent.vel_world.x, sent.vel_world.y, sent.vel_world.z], [-2, 0, 0.5])
    assert np.allclose([sent.world_from_body.w, sent.world_from_body.z], [0, 1])
    assert np.allclose([sent.ang_vel_body.x, sent.ang_vel_body.y, sent.ang_vel_body.z], [0.1, 0.2, 0.3])
    offset = time.time_ns() - time.monotonic_ns()
    assert min(abs(sent.stamp_ns + offset - stamp) for stamp in stamps) < 1e6


def test_poses_alone_make_odometry(bridge: BridgeRig, vehicle: VehicleEnd) -> None:
    bridge.start(
        ('message = "odometry"', 'message = "pose"'), ('velocity = "child"', 'velocity = "pose"'),
        ('rates = "twist"', 'rates = "pose"'),
    )  # fmt: skip
    begun = time.time_ns()

    def send() -> None:
        now = time.time_ns()
        motion = odometry(now, ((now - begun) * 3e-9, 0, 0), LEVEL, (0, 0, 0), (0, 0, 0))
        kind = "geometry_msgs/msg/PoseStamped"
        bridge.ros.publish(ODOMETRY, kind, new(kind, header=motion.header, pose=motion.pose.pose))

    until_sent(send, lambda: vehicle.motions, bridge)
    assert math.isclose(vehicle.motions[-1].vel_world.x, 3.0, rel_tol=1e-3)


def a_plan(stamp_ns: int) -> pb.Plan:
    def candidate(x: float, cost: float) -> pb.Candidate:
        end, zero = pb.Vec3f(x=x, y=1.0, z=2.0), pb.Vec3f()
        return pb.Candidate(end_pos_world=end, end_vel_world=zero, end_acc_world=zero, cost=cost)

    start, zero = pb.Vec3(z=2.0), pb.Vec3()
    return pb.Plan(
        frame_ns=stamp_ns, start_pos_world=start, start_vel_world=zero, start_acc_world=zero, duration_s=2.0,
        candidates=[candidate(3.0, 9.0), candidate(4.0, 1.0)], chosen=1,
    )  # fmt: skip


OUTPUTS = {
    TOPICS["output"][name]: kind
    for name, kind in {
        "plan": "nav_msgs/msg/Path",
        "candidates": "visualization_msgs/msg/MarkerArray",
        "target": "geometry_msgs/msg/PoseWithCovarianceStamped",
        "odometry": MOTION,
        "tf": "tf2_msgs/msg/TFMessage",
    }.items()
}


def test_what_the_vehicle_tells_is_read_by_rosbags(bridge: BridgeRig, vehicle: VehicleEnd) -> None:
    for topic, kind in OUTPUTS.items():
        bridge.ros.listen(topic, kind)
    bridge.start()
    stamp_ns = time.monotonic_ns()
    control = pb.Control(
        stamp_ns=stamp_ns, pos_world=pb.Vec3(x=1, y=2, z=3), vel_world=pb.Vec3(y=2),
        world_from_body=pb.Quat(w=math.sqrt(0.5), z=math.sqrt(0.5)),
    )  # fmt: skip
    target = pb.Target(stamp_ns=stamp_ns, pos_world=pb.Vec3(x=7), vel_world=pb.Vec3(), covariance_upper=range(21))

    def tell() -> None:
        vehicle.tell("plan", a_plan(stamp_ns))
        vehicle.tell("control", control)
        vehicle.tell("target", target)

    until_sent(tell, lambda: all(len(bridge.ros.heard[topic]) > 2 for topic in OUTPUTS), bridge)
    path, markers, seen, motion, tf = (bridge.ros.heard[topic][-1].message for topic in OUTPUTS)
    assert len(path.poses) == 20 and math.isclose(path.poses[-1].pose.position.x, 4.0)
    assert [(m.type, m.ns, len(m.points)) for m in markers.markers] == [(4, "candidates", 20)] * 2
    assert [(m.color.r, m.color.g) for m in markers.markers] == [(1.0, 0.0), (0.0, 1.0)]
    assert seen.pose.pose.position.x == 7.0 and list(seen.pose.covariance[6:9]) == [1.0, 6.0, 7.0]
    assert motion.child_frame_id == "base_link" and math.isclose(motion.twist.twist.linear.x, 2.0)
    [transform] = tf.transforms
    assert (transform.header.frame_id, transform.transform.translation.z) == ("map", 3.0)
    at_ns = motion.header.stamp.sec * 10**9 + motion.header.stamp.nanosec
    assert abs(at_ns - stamp_ns - (time.time_ns() - time.monotonic_ns())) < 1e6


def test_attachments_count_up_and_name_their_publisher(bridge: BridgeRig, vehicle: VehicleEnd) -> None:
    for topic in ("/goshawk/plan", "/goshawk/candidates"):
        bridge.ros.listen(topic, OUTPUTS[topic])
    bridge.start()
    arrived = bridge.ros.heard["/goshawk/candidates"]
    until_sent(lambda: vehicle.tell("plan", a_plan(time.monotonic_ns())), lambda: len(arrived) > 4, bridge)
    gids: list[set[bytes]] = []
    for topic in ("/goshawk/plan", "/goshawk/candidates"):
        parts = [struct.unpack("<qqB16s", heard.attachment) for heard in bridge.ros.heard[topic]]
        numbers = [part[0] for part in parts]
        assert all(b == a + 1 for a, b in itertools.pairwise(numbers)), numbers
        assert all(abs(part[1] - time.time_ns()) < 60e9 and part[2] == 16 for part in parts)
        gids.append({part[3] for part in parts})
    assert [len(found) for found in gids] == [1, 1] and gids[0] != gids[1]


def test_ros2_sees_the_node_and_its_topics_while_it_runs_and_not_after(bridge: BridgeRig) -> None:
    bridge.start()
    until(lambda: len(bridge.ros.tokens) == 10, str(bridge.ros.tokens))
    ends = bridge.ends()
    [node] = ends["NN"]
    session = node.split("/")[2]
    assert re.fullmatch(r"[1-9a-f][0-9a-f]*", session)
    assert node == f"@ros2_lv/0/{session}/0/0/NN/%/%/goshawk_bridge"

    def named(tokens: list[str]) -> dict[str, str]:
        parts = [token.split("/") for token in tokens]
        assert all(part[:4] == ["@ros2_lv", "0", session, "0"] and part[6:8] == ["%", "%"] for part in parts)
        return {part[9].replace("%", "/"): f"{part[10]}/{part[11]}" for part in parts}

    def wanted(topics: dict[str, str]) -> dict[str, str]:
        keys = {topic: bridge.ros.key(topic, kind) for topic, kind in topics.items()}
        return {topic: "/".join(key.rsplit("/", 2)[1:]) for topic, key in keys.items()}

    assert named(ends["MP"]) == wanted(OUTPUTS)
    inputs = {COLOUR: IMAGE, DEPTH: IMAGE, INFO: CAMERA_INFO, ODOMETRY: MOTION}
    assert named(ends["MS"]) == wanted(inputs)
    assert len({token.split("/")[4] for tokens in ends.values() for token in tokens}) == 10
    process = bridge.rig.processes["bridge"]
    process.send_signal(signal.SIGINT)
    assert process.wait(timeout=10) == 0, bridge.said()
    until(lambda: not bridge.ros.tokens, str(bridge.ros.tokens))


def test_after_the_router_went_and_came_back_the_bridge_goes_on(bridge: BridgeRig, vehicle: VehicleEnd) -> None:
    bridge.start()
    until_sent(lambda: send_images(bridge), lambda: vehicle.images, bridge)
    bridge.ros.close()
    bridge.ros = RosPeer(int(bridge.ros.endpoint.rpartition(":")[2]))
    until(lambda: len(bridge.ros.tokens) == 10, str(bridge.ros.tokens))
    vehicle.images.clear()
    until_sent(lambda: send_images(bridge), lambda: vehicle.images, bridge)


def test_every_bad_message_is_one_line_a_kind_and_good_ones_still_pass(bridge: BridgeRig, vehicle: VehicleEnd) -> None:
    bridge.start()
    until_sent(lambda: send_images(bridge), lambda: vehicle.images, bridge)
    now = time.time_ns
    good = bytes(STORE.serialize_cdr(image(now(), "rgb8", colours()), IMAGE))
    absurd = bytearray(good)
    at = len(good) - colours().size - 4
    assert struct.unpack_from("<I", absurd, at) == (colours().size,)
    struct.pack_into("<I", absurd, at, 2**31)
    for _ in range(20):
        bridge.ros.put(COLOUR, IMAGE, good[:-1])
        bridge.ros.put(COLOUR, IMAGE, bytes(absurd))
        bridge.ros.put(COLOUR, IMAGE, b"\0")
        bridge.ros.publish(COLOUR, IMAGE, image(now() - 3600 * 10**9, "rgb8", colours()))
        bridge.ros.publish(COLOUR, IMAGE, image(now(), "yuv422", colours()))
        bridge.ros.publish(DEPTH, IMAGE, image(now(), "16UC1", depths_mm()[:, :100]))
        bridge.ros.publish(ODOMETRY, MOTION, odometry(now(), (math.nan, 0, 0), LEVEL, (0, 0, 0), (0, 0, 0)))
        bridge.ros.put(ODOMETRY, MOTION, b"\0\1\0\0")
        time.sleep(0.02)
    bridge.ros.publish(INFO, CAMERA_INFO, camera_info(now(), distortion_model="equidistant", d=np.ones(4)))
    for line in [
        r"colour image refused: (not of this type|1 bytes)", r"colour image refused: its stamp is 3600\.\d\d s old",
        r'colour image refused: encoding "yuv422" is no colour',
        r"depth image refused: it is 100 x 384, and camera_info says 640 x 384",
        r"odometry refused: its position cannot be", r"odometry refused: not of this type",
        r'camera_info refused: the camera has distortion model "equidistant"',
    ]:  # fmt: skip
        until(lambda line=line: re.search(line, bridge.said()), line)
    lines = [line for line in bridge.said().splitlines() if " refused: " in line and " × " not in line]
    kinds = {
        "colour image": 4,
        "depth image": 3,
        "odometry": 3,
        "camera_info": 1,
    }  # a busy computer may add an old stamp
    assert all(sum(f"{what} refused" in line for line in lines) <= most for what, most in kinds.items()), lines
    assert vehicle.motions == []
    vehicle.images.clear()
    until_sent(lambda: send_images(bridge), lambda: vehicle.images, bridge)


def test_a_lens_that_sees_too_little_is_named(bridge: BridgeRig, vehicle: VehicleEnd) -> None:
    bridge.start()
    k = np.array([1.5 * FOCAL_PX, 0, (WIDTH - 1) / 2, 0, 1.5 * FOCAL_PX, (HEIGHT - 1) / 2, 0, 0, 1.0])
    until_sent(
        lambda: bridge.ros.publish(INFO, CAMERA_INFO, camera_info(time.time_ns(), k=k)),
        lambda: "the camera sees less than 90.0 x 61.9 degrees" in bridge.said(),
        bridge,
    )
    assert vehicle.images == []


def test_silence_says_which_topic_is_missing(bridge: BridgeRig) -> None:
    bridge.start()
    until_sent(
        lambda: bridge.ros.publish(COLOUR, IMAGE, image(time.time_ns(), "bgr8", colours())),
        lambda: f"no odometry in 10 s: see that {ODOMETRY} is published" in bridge.said(),
        bridge,
    )
    assert f"no depth image in 10 s: see that {DEPTH} is published" in bridge.said()
    assert "no colour image" not in bridge.said(), "one came, though it was no good one"


def test_no_vehicle_that_listens_is_told(bridge: BridgeRig) -> None:
    bridge.start()

    def send() -> None:
        now = time.time_ns()
        bridge.ros.publish(ODOMETRY, MOTION, odometry(now, (0, 0, 0), LEVEL, (0, 0, 0), (0, 0, 0)))

    until_sent(send, lambda: "messages not sent: no vehicle goshawk at tcp/" in bridge.said(), bridge)


def ran(*arguments: object) -> tuple[int, str]:
    command = [str(argument) for argument in (BIN / "goshawk-ros2", *arguments)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=20)
    return done.returncode, done.stdout + done.stderr


def test_a_bad_file_is_one_line_that_says_what_to_do(bridge: BridgeRig) -> None:
    config = bridge.rig.folder / "bad.toml"
    config.write_text(SHIPPED.read_text().replace("[ros]", "[ros]\ncolor = 1"))
    code, said = ran("--config", config)
    assert code == 1 and said.count("\n") == 1, said
    assert said.startswith(f"goshawk-ros2: {config}: unknown field `color`")
    config.write_text(SHIPPED.read_text().replace("tcp/127.0.0.1:7447", "foo"))
    code, said = ran("--config", config)
    assert code == 1 and said.endswith(
        "cannot dial ros.connect foo: it is no endpoint; an endpoint is such as tcp/127.0.0.1:7447\n"
    )
    code, said = ran("--config", bridge.rig.folder / "none.toml")
    assert code == 1 and said.count("\n") == 1 and "air/sensors/ros2/ros2.toml is one to begin with" in said
    assert ran("--config", SHIPPED, "--check") == (0, f"{SHIPPED} is good\n")
    code, said = ran("--help")
    assert code == 0 and "goshawk-ros2 --config air/sensors/ros2/ros2.toml" in said


def test_the_estimators_of_the_how_to_page_are_good_files(bridge: BridgeRig) -> None:
    page = (ROOT / "docs/how-to/ros2.md").read_text()
    sections: list[str] = re.findall(r"```toml\n(\[odometry\]\n.*?)```", page, re.DOTALL)
    assert len(sections) == 3
    config = bridge.rig.folder / "estimator.toml"
    for section in sections:
        text, changed = re.subn(r"\[odometry\].*?\n\n", section + "\n", SHIPPED.read_text(), flags=re.DOTALL)
        config.write_text(text)
        assert (changed, ran("--config", config, "--check")) == (1, (0, f"{config} is good\n"))


def test_a_vehicle_with_an_identity_is_fed_by_the_socket_as_the_how_to_page_has_it(
    bridge: BridgeRig, tmp_path: Path
) -> None:
    page = (ROOT / "docs/how-to/ros2.md").read_text().partition("## A vehicle with an identity")[2]
    rig, (flown, _) = bridge.rig, demo_identities(tmp_path / "keys")
    here = {
        "tls/0.0.0.0:7448": f"tls/127.0.0.1:{rig.zenoh_port}", "unixsock-stream//run/goshawk/sensors.sock": rig.socket,
        '"hawk"': '"goshawk"',
    }  # fmt: skip
    for page_has, here_is in here.items():
        assert page_has in page, page_has
        page = page.replace(page_has, here_is)
    listen, name, connect = (
        next(line for line in page.splitlines() if line.startswith(key))
        for key in ("listen = ", "name = ", "connect = ")
    )
    vehicle = tmp_path / "vehicle.toml"
    text = re.sub(r"^listen = .*$", f'{listen}\nidentity = "{flown}"', copied(), flags=re.MULTILINE)
    vehicle.write_text(text.replace('odometry = "autopilot"', 'odometry = "zenoh"'))
    bridge.start(('name = "goshawk"', name), (f'connect = "{rig.endpoint}"', connect))
    ending = threading.Event()

    def send() -> None:
        while not ending.wait(0.02):
            now = time.time_ns()
            bridge.ros.publish(ODOMETRY, MOTION, odometry(now, (0, 0, 0), LEVEL, (0, 0, 0), (0, 0, 0)))

    sending = threading.Thread(target=send)
    sending.start()
    checked = subprocess.run(
        [BIN / "goshawk-air", "check", "--config", vehicle, "--log-dir", tmp_path / "logs", "--wait", "4",
         "--mavlink-bind", f"127.0.0.1:{rig.mavlink_port}"],
        capture_output=True, text=True, timeout=60,
    )  # fmt: skip
    ending.set()
    sending.join()
    assert "listening on tls/" in checked.stdout, checked.stdout
    assert re.search(r"odometry +[\d.]+ Hz from in/odometry", checked.stdout), checked.stdout + bridge.said()
