"""Makes the seeds of the fuzz targets out of what the tree has: `python tests/fuzz/make_corpus.py`."""

from __future__ import annotations

import datetime
import io
import struct
import sys
from pathlib import Path

import numpy as np
from cryptography import x509
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.serialization import Encoding
from goshawk_proto import goshawk_pb2 as pb
from mcap.writer import CompressionType, Writer
from PIL import Image

ROOT = Path(__file__).resolve().parents[2]
CORPUS = Path(__file__).resolve().parent / "corpus"
NOW_NS = 5_000_000_000
POINTS = [(0.5 * k, 1.0 - k, 0.25 * k) for k in range(12)]


def _put(target: str, name: str, data: bytes) -> None:
    path = CORPUS / target / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(data)


def _mavlink() -> None:
    """Frames of a recorded PX4, from the log's start and from its flight, without the log's times."""
    log = (ROOT / "air/autopilot/tests/data/px4-offboard-takeoff.tlog").read_bytes()
    frames: list[bytes] = []
    at = 0
    while at + 8 + 12 <= len(log):
        begin = at + 8
        end = begin + 12 + log[begin + 1] + (13 if log[begin + 2] & 1 else 0)
        frames.append(log[begin:end])
        at = end
    kinds = {frame[7:10]: frame for frame in frames}
    for target in ["mavlink", "mavlink_messages"]:
        _put(target, "start", b"".join(frames[:80]))
        _put(target, "flight", b"".join(frames[len(frames) // 2 :][:80]))
        _put(target, "one_of_each", b"".join(kinds.values()))
    for number, frame in enumerate(kinds.values()):
        _put("mavlink_messages", f"kind_{number:02}", frame)


def _messages() -> None:
    rgbd = pb.Rgbd(
        seq=3, stamp_ns=NOW_NS - 1000, width=4, height=2, hfov_rad=1.57, vfov_rad=1.08,
        rgb=bytes(range(24)), depth_mm=b"\x34\x12" * 8,
    )  # fmt: skip
    motion = pb.Odometry(
        seq=1, stamp_ns=NOW_NS, pos_world=pb.Vec3(x=1, y=2, z=3), vel_world=pb.Vec3(x=0.5),
        world_from_body=pb.Quat(w=1), ang_vel_body=pb.Vec3(z=0.1),
    )  # fmt: skip
    _put("sensors", "rgbd", rgbd.SerializeToString(deterministic=True))
    _put("sensors", "odometry", motion.SerializeToString(deterministic=True))
    _put("commands", "start", pb.StartRequest(command_id="a-1", profile="chase").SerializeToString())
    _put("commands", "stop", pb.StopRequest(command_id="a-2").SerializeToString())
    for path in sorted((ROOT / "tests/proto").glob("*.bin")):
        _put("commands" if path.stem in {"StartRequest", "StopRequest"} else "sensors", path.stem, path.read_bytes())


def _mcap() -> None:
    kinds = {"zstd": CompressionType.ZSTD, "lz4": CompressionType.LZ4, "plain": CompressionType.NONE}
    for name, compression in kinds.items():
        out = io.BytesIO()
        writer = Writer(out, chunk_size=400, compression=compression)
        writer.start(library="goshawk")
        schema = writer.register_schema("goshawk.v1.Odometry", "protobuf", b"")
        channel = writer.register_channel("log/odometry", "protobuf", schema)
        for k in range(24):
            data = pb.Odometry(seq=k, stamp_ns=k).SerializeToString() + bytes(20)
            writer.add_message(channel, log_time=k, publish_time=k, data=data)
        writer.finish()
        _put("mcap", name, out.getvalue())


def _clouds() -> None:
    rows = "".join(f"{x} {y} {z} 10 20 30\n" for x, y, z in POINTS)
    flat = b"".join(struct.pack("<3f", *point) for point in POINTS)
    axes = "".join(f"property float {axis}\n" for axis in "xyz")
    colours = "".join(f"property uchar {name}\n" for name in ("red", "green", "blue"))
    vertex = f"element vertex {len(POINTS)}\n{axes}"
    faces = "element face 1\nproperty list uchar int vertex_indices\n"
    _put(
        "ply",
        "ascii",
        f"ply\nformat ascii 1.0\ncomment seed\n{vertex}{colours}{faces}end_header\n{rows}3 0 1 2\n".encode(),
    )
    _put("ply", "binary", f"ply\nformat binary_little_endian 1.0\n{vertex}end_header\n".encode() + flat)
    face = b"\x03" + struct.pack("<3i", 0, 1, 2)
    _put(
        "ply",
        "faces_first",
        f"ply\nformat binary_little_endian 1.0\n{faces}{vertex}end_header\n".encode() + face + flat,
    )
    head = (
        "VERSION 0.7\nFIELDS x y z rgb\nSIZE 4 4 4 4\nTYPE F F F U\nCOUNT 1 1 1 1\n"
        f"WIDTH {len(POINTS)}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {len(POINTS)}\nDATA "
    )
    _put("pcd", "ascii", (head + "ascii\n" + "".join(f"{x} {y} {z} 660510\n" for x, y, z in POINTS)).encode())
    packed = b"".join(struct.pack("<3fI", *point, 660510) for point in POINTS)
    _put("pcd", "binary", (head + "binary\n").encode() + packed)
    columns = b"".join(struct.pack(f"<{len(POINTS)}f", *axis) for axis in zip(*POINTS, strict=True))
    columns += struct.pack(f"<{len(POINTS)}I", *[660510] * len(POINTS))
    pieces = [columns[k : k + 32] for k in range(0, len(columns), 32)]
    literal = b"".join(bytes([len(piece) - 1]) + piece for piece in pieces)  # LZF without a repetition
    sizes = struct.pack("<2I", len(literal), len(columns))
    _put("pcd", "compressed", (head + "binary_compressed\n").encode() + sizes + literal)


def _texts() -> None:
    _put("contract", "contract", (ROOT / "air/policy/tests/contract.json").read_bytes())
    for name in ["sim", "tuning"]:
        _put("vehicle_file", name, (ROOT / f"air/vehicles/{name}.toml").read_bytes())
    for name in ["goshawk/kite-1/tel/plan", "goshawk/kite/cmd/stop", "kite-1", "goshawk/*/tel/health"]:
        _put("keys", name.replace("/", ".").replace("*", "any"), name.encode())


def _identity() -> None:
    """A certificate of the vehicle `kite` that does not end; nobody has its key."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(x509.NameOID.COMMON_NAME, "vehicle.kite")])
    utc = datetime.UTC
    certificate = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(datetime.datetime(2020, 1, 1, tzinfo=utc))
        .not_valid_after(datetime.datetime(9999, 12, 31, tzinfo=utc))
        .sign(key, SHA256())
    )
    _put("identity", "cert.pem", certificate.public_bytes(Encoding.PEM))
    _put("identity", "access.toml", b'operators = ["alice"]\nobservers = ["bob", "eve-2"]\n')


def _ros2() -> None:
    """Messages as rosbags writes them, of a camera of 24 x 15 and of one moment."""
    sys.path.append(str(ROOT / "tests/ros2"))
    from pictures import camera_info, compressed, image, odometry
    from ros_peer import STORE, new

    stamp_ns, width, height = 1_700_000_000_000_000_000, 24, 15
    rgb = np.arange(3 * width * height, dtype=np.uint32).reshape(height, width, 3).astype(np.uint8)
    depth = 1000 + np.arange(width * height, dtype="<u2").reshape(height, width)
    png = io.BytesIO()
    Image.fromarray(rgb).save(png, "PNG")
    k = np.array([12, 0, 11.5, 0, 12, 7, 0, 0, 1.0])
    moved = odometry(stamp_ns, (1, 2, 3), (0, 0, 0, 1), (0.5, 0, 0), (0, 0, 0.1))
    messages = {
        "camera_info": ("sensor_msgs/msg/CameraInfo", camera_info(stamp_ns, width=width, height=height, k=k)),
        "colour": ("sensor_msgs/msg/Image", image(stamp_ns, "rgb8", rgb)),
        "depth": ("sensor_msgs/msg/Image", image(stamp_ns, "16UC1", depth)),
        "depth_m": ("sensor_msgs/msg/Image", image(stamp_ns, "32FC1", (1e-3 * depth).astype("<f4"))),
        "compressed": ("sensor_msgs/msg/CompressedImage", compressed(stamp_ns, "rgb8; png compressed", png.getvalue())),
        "odometry": ("nav_msgs/msg/Odometry", moved),
        "pose": ("geometry_msgs/msg/PoseStamped", new(
            "geometry_msgs/msg/PoseStamped", header=moved.header, pose=moved.pose.pose)),
    }  # fmt: skip
    for name, (kind, message) in messages.items():
        _put("ros2", name, bytes(STORE.serialize_cdr(message, kind)))


def main() -> None:
    """Writes the seeds; those that a crash left (`crash-*`) stay."""
    for path in CORPUS.glob("*/*"):
        if not path.name.startswith("crash-"):
            path.unlink()
    for make in [_mavlink, _messages, _mcap, _clouds, _texts, _identity, _ros2]:
        make()


if __name__ == "__main__":
    main()
