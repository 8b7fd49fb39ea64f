"""A camera that lies and a network that is dead, over real processes: named, not flown with, no start."""

from __future__ import annotations

import hashlib
import shutil
import threading
import time
from pathlib import Path

import numpy as np
import onnx
import pytest
import zenoh
from goshawk_dashboards.state.snapshot import Snapshot
from goshawk_ground.link import DEFAULT_VEHICLE, GroundLink
from goshawk_ground.link.dial import client_config
from goshawk_proto import goshawk_pb2, key_expression
from goshawk_proto import goshawk_pb2 as pb
from onnx import numpy_helper
from rig import VEHICLE, Rig, copied
from test_bad_input import air

MODELS = VEHICLE.parent.parent / "models"
SECOND_HZ = 77


def failing(snap: Snapshot | None) -> dict[str, str]:
    assert snap is not None and snap.health is not None
    return {check.name: check.reason for check in snap.health.checks if not check.ok}


def names(name: str, word: str):
    """Whether the check of that name fails with that word."""

    def seen(snap: Snapshot) -> bool:
        return snap.health is not None and any(
            check.name == name and not check.ok and check.reason.startswith(word) for check in snap.health.checks
        )

    return seen


def flying(rig: Rig, link: GroundLink, *sim: str) -> None:
    rig.air()
    rig.sim("--seed", "3", *sim)
    ready = link.wait_for(lambda s: s.health is not None and s.health.ready, 30.0)
    assert ready is not None, rig.output("air")
    assert link.start().accepted
    assert (
        link.wait_for(lambda s: s.control is not None and s.mode in {pb.MODE_TRACK, pb.MODE_SEARCH}, 40.0) is not None
    )


def test_a_frozen_camera_is_named_in_flight_and_the_vehicle_comes_down_by_itself(rig: Rig) -> None:
    with rig.link() as link:
        flying(rig, link, "--fault", "camera-frozen")
        assert link.wait_for(names("camera", "frozen"), 20.0) is not None, rig.output("air")
        assert link.wait_for(lambda s: s.mode in {pb.MODE_STOPPING, pb.MODE_LANDED, pb.MODE_IDLE}, 40.0) is not None
    assert "readiness: camera: frozen" in rig.output("air")


def second_camera(endpoint: str, stop: threading.Event) -> None:
    """Publishes pictures of its own on the vehicle's camera key."""
    rng = np.random.default_rng(1)
    session = zenoh.open(client_config(endpoint))
    publisher = session.declare_publisher(key_expression("rgbd", DEFAULT_VEHICLE))
    seq = 100_000
    while not stop.is_set():
        seq += 1
        frame = goshawk_pb2.Rgbd(
            seq=seq, stamp_ns=time.monotonic_ns(), width=160, height=96, hfov_rad=1.5708, vfov_rad=1.0808,
            rgb=np.repeat(np.arange(15360) % 160 + rng.integers(0, 9, 15360), 3).astype(np.uint8).tobytes(),
            depth_mm=(3000 + np.arange(15360) // 8 + rng.integers(0, 20, 15360)).astype("<u2").tobytes(),
        )  # fmt: skip
        publisher.put(frame.SerializeToString())
        time.sleep(1 / SECOND_HZ)
    session.close()


def test_a_second_camera_on_the_key_is_named_in_flight_and_the_vehicle_stops(rig: Rig) -> None:
    stop = threading.Event()
    intruder = threading.Thread(target=second_camera, args=(rig.endpoint, stop))
    with rig.link() as link:
        flying(rig, link)
        intruder.start()
        try:
            assert link.wait_for(names("camera", "two-cameras"), 10.0) is not None, rig.output("air")
            held = link.wait_for(
                lambda s: (
                    s.control is not None
                    and s.control.fallback in {pb.FALLBACK_PLAN_EXPIRED_BRAKE, pb.FALLBACK_HOLD_POSITION}
                ),
                10.0,
            )
            assert held is not None
        finally:
            stop.set()
            intruder.join()


def dead(kind: str, folder: Path) -> Path:
    """The shipped policy with other weights, its golden images beside it, and a vehicle file that pins it."""
    rng = np.random.default_rng(5)
    model = onnx.load(MODELS / "track-32bit.onnx")
    for tensor in model.graph.initializer:
        if tensor.data_type != onnx.TensorProto.FLOAT:
            continue
        shape = numpy_helper.to_array(tensor).shape
        value = {"nan": np.nan, "infinite": np.inf, "zero": 0.0}.get(kind)
        weights = 0.1 * rng.standard_normal(shape) if value is None else np.full(shape, value)
        tensor.CopyFrom(numpy_helper.from_array(weights.astype(np.float32), tensor.name))
    path = folder / "dead.onnx"
    onnx.save(model, path)
    shutil.copy(MODELS / "track-32bit.golden", folder / "dead.golden")
    return vehicle(folder, path, hashlib.sha256(path.read_bytes()).hexdigest())


def vehicle(folder: Path, model: Path, sha256: str) -> Path:
    """The shipped vehicle file with another policy."""
    lines = copied().splitlines()
    new = {"model = ": f'model = "{model}"', "sha256 = ": f'sha256 = "{sha256}"'}
    text = "\n".join(next((to for key, to in new.items() if line.startswith(key)), line) for line in lines)
    path = folder / "vehicle.toml"
    path.write_text(text + "\n")
    return path


@pytest.mark.parametrize("kind", ["nan", "infinite", "zero", "random"])
def test_a_network_with_dead_weights_is_not_ready_and_does_not_start(rig: Rig, tmp_path: Path, kind: str) -> None:
    config = dead(kind, tmp_path)
    rig.air(vehicle=config)
    rig.sim("--seed", "3")
    with rig.link() as link:
        # All else is ready, so that it is the policy alone that keeps it on the ground.
        snap = link.wait_for(lambda s: s.health is not None and set(failing(s)) == {"policy"}, 30.0)
        assert snap is not None, rig.output("air")
        assert "golden image" in failing(snap)["policy"]
        reply = link.start()
        assert not reply.accepted
        assert "not ready" in reply.text


def test_another_model_than_the_pinned_one_is_refused_with_both_hashes(tmp_path: Path) -> None:
    model = MODELS / "track.onnx"
    line = air("--config", vehicle(tmp_path, model, "0" * 64))
    assert hashlib.sha256(model.read_bytes()).hexdigest() in line
    assert "0" * 64 in line
    assert "policy.sha256" in line


def test_a_policy_without_golden_images_is_not_ready(rig: Rig, tmp_path: Path) -> None:
    model = tmp_path / "bare.onnx"
    shutil.copy(MODELS / "track.onnx", model)
    rig.air("--policy", model)
    with rig.link() as link:
        snap = link.wait_for(lambda s: s.health is not None, 20.0)
        assert "goshawk-sim golden" in failing(snap)["policy"]
