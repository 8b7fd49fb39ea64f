"""Data sets of flights: the simulator flies, and its log must say what its world and its target truly were."""

from __future__ import annotations

import dataclasses
import json
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import numpy as np
import onnx
import pytest
import torch
from command import goshawk
from goshawk_dashboards.log.flight import Flight
from goshawk_proto import goshawk_pb2 as pb
from goshawk_train.config import Config
from goshawk_train.costs.assign import assign
from goshawk_train.data import DataError, batches, layout
from goshawk_train.data.check.report import check
from goshawk_train.data.flown.convert import Choice, from_logs
from goshawk_train.data.flown.fuse import Fusion
from goshawk_train.data.flown.mine import Other
from goshawk_train.data.flown.recording import FIELD_OF_VIEW, read
from goshawk_train.data.flown.smooth import smooth
from goshawk_train.data.foreign.resample import OURS
from goshawk_train.data.layout import Labels, alone
from goshawk_train.data.ply import read_ply
from goshawk_train.model import geometry
from goshawk_train.run import train
from mcap.writer import Writer
from numpy.typing import NDArray
from scipy.spatial import KDTree

F64 = NDArray[np.float64]
ROOT = Path(__file__).parents[3]
SIMULATOR = ROOT / "target" / "release" / "goshawk-sim"
NAVIGATE = ROOT / "air/models/navigate-32bit.onnx"
TRACK, PAPER = ROOT / "air/models/track-32bit.onnx", ROOT / "air/models/paper.onnx"
SCENE = "scene_0000"


def fly(folder: Path, *options: str, task: str = "track", seed: int = 414) -> Path:
    """One flight's log."""
    model = TRACK if task == "track" else NAVIGATE
    command = [str(SIMULATOR), "fly", "--task", task, "--speed", "4", "--trials", "1", "--seed", str(seed)]
    command += ["--policy", str(model)]
    command += ["--threads", "1", "--log", str(folder), *options]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    (log,) = folder.glob("*.mcap")
    return log


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return fly(tmp_path_factory.mktemp("logs"))


@pytest.fixture(scope="module")
def lost(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a flight whose evader hides, and is found again."""
    return fly(tmp_path_factory.mktemp("logs"), "--evader", "reactive", seed=435)


@pytest.fixture(scope="module")
def flown(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("data") / "flown"
    done = goshawk("dataset", "from-log", log, "--out", out, "--rate-hz", 4, "--mine", "near-miss,lost,doubt")
    assert done.exit_code == 0, done.stderr
    assert f"next: goshawk dataset check {out}" in done.stdout
    return out


@pytest.fixture(scope="module")
def scan(log: Path, tmp_path_factory: pytest.TempPathFactory) -> F64:
    """The surfaces of the log's world, as a laser scanner sees them."""
    world = cast("pb.SimWorld", Flight.open(log).message("world", 0))
    cloud = tmp_path_factory.mktemp("world") / "scan.ply"
    command = [str(SIMULATOR), "world", "--seed", str(world.seed), "--spacing", str(world.spacing_m)]
    command += ["--scan", str(cloud), "--output", str(cloud.with_suffix(".png"))]
    subprocess.run(command, cwd=ROOT, check=True, capture_output=True)
    return read_ply(cloud).astype(np.float64)


def nearest(of: F64, among: F64) -> F64:
    return cast("Any", KDTree(among)).query(of)[0]


def truth(log: Path, stamps: F64) -> F64:
    """Where the target truly was, relative to where the vehicle truly was."""
    known = Flight.open(log).columns("sim_truth", ["stamp_ns", "pos_world", "target_pos_world"])
    off = known["target_pos_world"] - known["pos_world"]
    return np.column_stack([np.interp(stamps, known["stamp_ns"], off[:, axis]) for axis in range(3)])


def kept_stamps(log: Path, labels: Labels) -> F64:
    """The capture of each labelled image: the log's image that was taken there."""
    recording = read(log)
    distance, place = cast(
        "tuple[F64, NDArray[np.int64]]", cast("Any", KDTree(recording.pos_world_F3)).query(labels.pos_world_F3)
    )
    assert distance.max() < 1e-5
    return recording.stamp_F[place].astype(np.float64)


def test_the_fused_map_is_the_worlds_where_it_was_seen(flown: Path, scan: F64) -> None:
    ground, bounds = layout.read_ground(flown / SCENE)
    points = read_ply(flown / SCENE / "environment.ply").astype(np.float64)
    standing = scan[scan[:, 2] > ground.at(scan) + 0.35]
    # Half a voxel's diagonal, and the odometry's drift of 0.1 m or more; what fills a trunk lies behind its surface.
    assert np.mean(nearest(points, standing) < 0.3) > 0.75
    assert np.mean(nearest(points, standing) < 0.5) > 0.95
    labels = layout.read_labels(flown / SCENE / "labels.csv", 0)
    beside = standing[nearest(standing, labels.pos_world_F3) < 2.5]
    assert len(beside) > 500
    assert np.mean(nearest(beside, points) < 0.3) > 0.85
    under = scan[(nearest(scan[:, :2], labels.pos_world_F3[:, :2]) < 4) & (np.abs(scan[:, 2] - ground.at(scan)) < 0.3)]
    assert np.median(np.abs(under[:, 2] - ground.at(under))) < 0.2
    assert (bounds.min_xyz < labels.pos_world_F3.min(axis=0)).all()


def test_the_target_is_no_obstacle(log: Path, flown: Path, scan: F64) -> None:
    """Where it ran there is nothing in the map but what the world has there."""
    points = read_ply(flown / SCENE / "environment.ply").astype(np.float64)
    known = Flight.open(log).columns("sim_truth", ["target_pos_world"])["target_pos_world"]
    at_target = points[nearest(points, known) < 0.5]
    assert len(known) > 100 and (nearest(at_target, scan) > 0.6).sum() < 20


def test_labels_are_where_the_target_truly_was(log: Path, flown: Path) -> None:
    labels = layout.read_labels(flown / SCENE / "labels.csv", 0)
    known = labels.has_target_F
    off = (labels.target_world_F3 - labels.pos_world_F3)[known]
    error = np.linalg.norm(off - truth(log, kept_stamps(log, labels))[known], axis=1)
    assert known.mean() > 0.85
    assert np.median(error) < 0.3 and np.percentile(error, 95) < 0.6


def test_a_hidden_target_is_not_labelled_visible(lost: Path, tmp_path: Path) -> None:
    from_logs([lost], tmp_path, Choice(rate_hz=4, mine=("lost",)))
    labels = layout.read_labels(tmp_path / SCENE / "labels.csv", 0)
    told = Flight.open(lost).columns("sim_truth", ["stamp_ns", "target_visible"])
    place = np.searchsorted(told["stamp_ns"], kept_stamps(lost, labels))
    visible = told["target_visible"].astype(bool)[np.minimum(place, len(told) - 1)]
    assert (~visible).sum() >= 5, "the flight of this seed loses its target"
    assert (labels.visible_F[~visible] >= 0.5).mean() < 0.1
    assert (labels.visible_F[visible] >= 0.5).mean() > 0.85


def test_a_data_set_of_flights_passes_the_check(flown: Path) -> None:
    report = check(flown)
    assert report.errors == []
    about = json.loads((flown / SCENE / "scene.json").read_text())
    assert about["flight"]["vehicle"] == "goshawk" and about["flight"]["camera_tilt_deg"] == 5.0
    assert layout.describe(flown) == "flown: 1 scenes imported from 1 flight of goshawk"


def test_a_data_set_of_flights_trains_and_mixes_with_another(flown: Path, dataset: Path, small: Config) -> None:
    alone, _ = batches.load(dataset, small)
    frames, maps = batches.load(dataset, small, also=[flown])
    assert len(maps.base_S) == 3 and set(frames.labels.scene_F.tolist()) == {0, 1, 2}
    assert np.array_equal(frames.rgb_FHW3[: len(alone)], alone.rgb_FHW3[:])
    trainer = train.Trainer(small, frames, maps, data_name="mixed")
    assert all(np.isfinite(float(trainer.advance()["loss"])) for _ in range(3))


def test_the_command_trains_on_several_data_sets(flown: Path, dataset: Path, tmp_path: Path) -> None:
    config = ROOT / "ground/train/configs/track.toml"
    options = ("--data", dataset, "--data", flown, "--out", tmp_path / "run", "--samples", 128, "--threads", 1)
    done = goshawk("train", "run", "--config", config, *options)
    assert done.exit_code == 0, done.stderr
    saved = torch.load(tmp_path / "run" / "checkpoint.pt", weights_only=True)
    assert saved["data"].endswith("; flown: 1 scenes imported from 1 flight of goshawk")


def test_an_unknown_target_is_neither_shown_nor_absent(config: Config, tmp_path: Path, dataset: Path) -> None:
    """It stays unknown on disk, and no cell learns from it whether a target is there."""
    labels = layout.read_labels(dataset / SCENE / "labels.csv", 0)
    visible = labels.visible_F.copy()
    visible[3] = np.nan
    has_target = labels.has_target_F & (np.arange(len(labels)) != 3)
    ground, bounds = layout.read_ground(dataset / SCENE)
    rgb, depth = layout.read_images(dataset / SCENE, len(labels), layout.read_view(dataset))
    scene = layout.Scene(
        rgb_FHW3=np.asarray(rgb),
        depth_FHW=np.asarray(depth),
        labels=dataclasses.replace(labels, visible_F=visible, has_target_F=has_target),
        points_P3=read_ply(dataset / SCENE / "environment.ply"),
        ground=ground,
        bounds=bounds,
        about={},
    )
    layout.write_scene(tmp_path / SCENE, scene)
    again = layout.read_labels(tmp_path / SCENE / "labels.csv", 0)
    assert np.flatnonzero(np.isnan(again.visible_F)).tolist() == [3] and not again.has_target_F[3]
    groups = assign(torch.zeros(2, 3), torch.tensor([float("nan"), 0.0]), config)
    assert groups.ignored_BN[0].all() and groups.negative_BN[1].all()


def test_a_policy_agrees_with_itself_and_not_with_a_worse_one(log: Path, tmp_path: Path) -> None:
    recording = read(log)
    frames = np.arange(0, len(recording.stamp_F), 20)
    assert not Other(TRACK).differs(recording, frames).any()
    worse = tmp_path / "worse.onnx"
    model = onnx.load(str(TRACK))
    (weight,) = (entry for entry in model.graph.initializer if entry.name == "out.weight")
    values = onnx.numpy_helper.to_array(weight)
    noisy = values + np.random.default_rng(1).normal(0, 2 * values.std(), values.shape)
    weight.CopyFrom(onnx.numpy_helper.from_array(noisy.astype(np.float32), weight.name))
    onnx.save(model, str(worse))
    assert Other(worse).differs(recording, frames).mean() > 0.5


def test_mined_images_are_kept_but_those_of_an_unseen_view_and_counted_by_reason(lost: Path, tmp_path: Path) -> None:
    outcome = from_logs([lost], tmp_path / "out", Choice(rate_hz=0, mine=("lost",)))
    recording = read(lost)
    phases = [phase for phase in recording.flight.phases if phase.name == "lost"]
    time = recording.time_F
    around = np.any([(time >= phase.start_s - 2) & (time <= phase.end_s + 0.2) for phase in phases], axis=0)
    found = outcome.found
    assert found["lost"] == around.sum()
    assert outcome.kept == outcome.of_kept["lost"] >= found["lost"] - found["view ahead never seen"] > 30


def test_a_jump_of_the_odometry_begins_a_new_scene(tmp_path: Path) -> None:
    log = fly(tmp_path / "logs", "--set", "odometry.jump_every_s=6", "--set", "odometry.jump_m=1.0")
    jumps = Flight.open(log).columns("odometry", ["reset_counter"])["reset_counter"]
    outcome = from_logs([log], tmp_path / "out", Choice())
    assert 1 < outcome.scenes <= jumps.max() - jumps.min() + 1
    assert [f.line() for f in check(tmp_path / "out").errors] == []


def test_a_navigation_says_nothing_of_a_target(tmp_path: Path) -> None:
    from_logs([fly(tmp_path / "logs", task="navigate")], tmp_path / "out", Choice())
    labels = layout.read_labels(tmp_path / "out" / SCENE / "labels.csv", 0)
    assert not labels.has_target_F.any() and np.isnan(labels.visible_F).all()
    assert [f.line() for f in check(tmp_path / "out", task="navigate").errors] == []


def test_what_no_image_shows_is_unknown_and_free_but_right_behind_a_surface() -> None:
    """A camera 1.5 m over the ground, which looks at a wall 4 m ahead."""
    pos, rays = np.array([0.1, 0.1, 1.5]), geometry.pixel_rays(OURS)
    ground_m = np.where(rays[..., 2] < 0, -1.5 / np.minimum(rays[..., 2], -1e-6), np.inf)
    depth = np.rint(1000 * np.minimum(ground_m, 4.0)).astype(np.uint16)
    fusion = Fusion(OURS, pos[None])
    for _ in range(2):
        fusion.add(depth, pos, np.eye(3), None)
    fused = fusion.result()
    ahead = pos + np.array([[2.0, 0, 0], [4.0, 0, 0], [6.0, 0, 0], [90.0, 0, 0]])
    assert fused.known(ahead).tolist() == [True, True, False, False]
    level = fused.points_P3[(np.abs(fused.points_P3[:, 1] - 0.1) < 0.15) & (np.abs(fused.points_P3[:, 2] - 1.5) < 0.15)]
    assert sorted({round(float(x), 1) for x in level[:, 0]}) == [4.1, 4.3, 4.5]
    assert np.abs(fused.ground.at(np.array([3.0, 0.0, 0.0]))) < 0.05


def test_a_log_that_was_cut_off_gives_what_it_has(log: Path, tmp_path: Path) -> None:
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    half, whole = (from_logs([path], tmp_path / path.stem, Choice()).kept for path in (cut, log))
    assert 0.2 * whole < half < 0.7 * whole


def test_a_smoothed_motion_is_nearer_to_the_truth_than_what_was_measured() -> None:
    """Also at times before the first measurement, from what came later."""
    rng, times = np.random.default_rng(3), np.arange(0.0, 6.0, 0.05)
    true = np.column_stack([3 * times, np.sin(times), np.full(len(times), 1.0)])
    measured: NDArray[np.bool_] = np.asarray(times > 0.3)
    seen = np.where(measured[:, None], true + rng.normal(0, 0.2, true.shape), 0.0)
    noise = np.tile(0.2**2 * np.eye(3), (len(times), 1, 1))
    smoothed = smooth(times, measured, seen, noise, acceleration=2.0)
    error: F64 = np.sqrt(np.sum((smoothed.pos_T3 - true) ** 2, axis=1))
    assert np.sqrt(np.mean(error[measured] ** 2)) < 0.6 * 0.2 * np.sqrt(3)
    assert (error < 5 * smoothed.std_T).all() and error[~measured].max() < 0.6
    assert smoothed.std_T[0] > smoothed.std_T[len(times) // 2]


def rewritten(log: Path, out: Path, change: Callable[[str, bytes], bytes | None]) -> Path:
    """A copy of the log's first seconds, with other records or without some."""
    flight = Flight.open(log)
    with out.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        ids: dict[int, int] = {}
        for channel, sequence, time_ns, payload in flight.log.records():
            changed = change(channel.topic, payload) if time_ns < flight.start_ns + 6_000_000_000 else None
            if changed is None:
                continue
            if channel.id not in ids:
                schema = flight.log.schema_of(channel)
                assert schema is not None
                schema_id = writer.register_schema(schema.name, schema.encoding, schema.data)
                ids[channel.id] = writer.register_channel(channel.topic, channel.message_encoding, schema_id)
            writer.add_message(ids[channel.id], time_ns, changed, time_ns, sequence)
        writer.finish()
    return out


def without(topic: str) -> Callable[[str, bytes], bytes | None]:
    return lambda of, payload: None if of == topic else payload


def seen_by(share: float) -> Callable[[str, bytes], bytes]:
    """The same images, as if a lens had taken them that sees this share of the width."""

    def change(topic: str, payload: bytes) -> bytes:
        if topic != "log/rgbd":
            return payload
        image = pb.CompressedRgbd.FromString(payload)
        image.hfov_rad *= share
        return image.SerializeToString()

    return change


def without_a_vehicle_file(topic: str, payload: bytes) -> bytes:
    if topic != "log/header":
        return payload
    header = pb.LogHeader.FromString(payload)
    header.vehicle_toml = ""
    return header.SerializeToString()


def with_a_broken_picture(topic: str, payload: bytes) -> bytes:
    if topic != "log/rgbd":
        return payload
    image = pb.CompressedRgbd.FromString(payload)
    image.depth_png = image.depth_png[:100]
    return image.SerializeToString()


@pytest.mark.parametrize("share", [0.985, 1.015])
def test_a_lens_that_sees_a_little_more_or_less_is_brought_to_the_policies_view(
    log: Path, tmp_path: Path, share: float
) -> None:
    other = read(rewritten(log, tmp_path / "other.mcap", seen_by(share)))
    same = read(rewritten(log, tmp_path / "same.mcap", seen_by(1.0)))
    # Where the other lens has what we see in each of our columns, and whether it is within its image.
    tangent_U = (np.arange(OURS.width) + 0.5 - OURS.width / 2) / OURS.focal_px
    column_U = np.floor((1 + tangent_U / np.tan(share * OURS.hfov_rad / 2)) * OURS.width / 2).astype(int)
    inside_U = (column_U >= 0) & (column_U < OURS.width)
    assert inside_U.all() == (share > 1) and inside_U.mean() > 0.95
    frame = len(same.stamp_F) // 2
    depth = other.depth(frame)
    assert np.array_equal(depth[:, inside_U], same.depth(frame)[:, column_U[inside_U]])
    assert not depth[:, ~inside_U].any()
    middle = slice(OURS.width // 2 - 5, OURS.width // 2 + 5)
    off = other.rgb(frame).astype(int)[:, middle] - same.rgb(frame)[:, middle]
    assert np.abs(off).mean() < 10
    assert from_logs([other.flight.path], tmp_path / "out", Choice()).kept > 0


def test_a_log_is_learnt_from_as_far_as_the_vehicle_flies_with_its_camera() -> None:
    vehicle = (ROOT / "air/policy/src/preprocess.rs").read_text()
    assert f"pub const FIELD_OF_VIEW_TOLERANCE: f64 = {FIELD_OF_VIEW};" in vehicle


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (without("log/rgbd"), "holds no images"),
        (without("log/odometry"), "holds no odometry around its images"),
        (without("tel/control"), "holds no image that was taken in flight"),
        (without_a_vehicle_file, "holds no vehicle file with a camera"),
        (seen_by(0.975), "its images are 160 x 96 at 87.8 x 61.9 deg, the policies see 160 x 96 at 90.0 x 61.9 deg"),
        (seen_by(1.025), "its images are 160 x 96 at 92.2 x 61.9 deg, the policies see"),
        (with_a_broken_picture, "is broken"),
    ],
)
def test_a_log_that_cannot_be_trained_on_is_one_line_and_leaves_nothing(
    log: Path, tmp_path: Path, change: Callable[[str, bytes], bytes | None], said: str
) -> None:
    bad = rewritten(log, tmp_path / "bad.mcap", change)
    done = goshawk("dataset", "from-log", bad, "--out", tmp_path / "out", "--rate-hz", 1)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"goshawk dataset from-log: {bad}") and said in done.stderr
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["bad.mcap"]


def test_a_bad_log_after_a_good_one_leaves_nothing_of_either(log: Path, tmp_path: Path) -> None:
    foreign = tmp_path / "photo.mcap"
    foreign.write_bytes(b"\xff\xd8\xff" * 100)
    with pytest.raises(DataError, match="is no flight log"):
        from_logs([log, foreign], tmp_path / "out", Choice(rate_hz=1))
    assert list(tmp_path.iterdir()) == [foreign]


def test_what_is_no_log_is_one_line(tmp_path: Path) -> None:
    foreign = tmp_path / "photo.mcap"
    foreign.write_bytes(b"\xff\xd8\xff" * 100)
    done = goshawk("dataset", "from-log", foreign, "--out", tmp_path / "out")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert f"{foreign} is no flight log" in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_folder_that_holds_something_is_not_written_over(log: Path, flown: Path) -> None:
    with pytest.raises(DataError, match="is there already: choose another --out"):
        from_logs([log], flown, Choice())


def test_a_log_that_is_named_twice_is_one(log: Path, tmp_path: Path) -> None:
    (tmp_path / "again.mcap").symlink_to(log)
    outcome = from_logs(
        [log, tmp_path / "again.mcap", log.parent / "." / log.name], tmp_path / "out", Choice(rate_hz=1)
    )
    once = from_logs([log], tmp_path / "once", Choice(rate_hz=1))
    assert outcome.of_kept == once.of_kept and outcome.scenes == once.scenes


def test_two_at_once_are_kept_apart_and_what_a_killed_one_left_is_removed(log: Path, tmp_path: Path) -> None:
    left = tmp_path / ".out.partial"
    (left / "scene_0000").mkdir(parents=True)
    (left / "note").touch()
    with alone(left), pytest.raises(DataError, match="another command fills it now"):
        from_logs([log], tmp_path / "out", Choice(rate_hz=1))
    assert (left / "note").exists()
    from_logs([log], tmp_path / "out", Choice(rate_hz=1))
    assert list(tmp_path.iterdir()) == [tmp_path / "out"] and not (tmp_path / "out/note").exists()


def test_a_policy_that_is_told_other_things_cannot_disagree(log: Path, tmp_path: Path) -> None:
    options = ("--mine", "disagree", "--other", PAPER)
    done = goshawk("dataset", "from-log", log, "--out", tmp_path / "out", *options)
    assert done.exit_code == 2 and f"{PAPER} is told other things than the policy that flew" in done.stderr
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("wrong", [("--mine", "luck"), ("--mine", "disagree"), ("--other", TRACK), ("--rate-hz", -1)])
def test_options_that_cannot_be_are_wrong_usage(wrong: tuple[str, object], log: Path, tmp_path: Path) -> None:
    done = goshawk("dataset", "from-log", log, "--out", tmp_path / "out", *wrong)
    assert done.exit_code == 2 and "Error" in done.stderr
    assert not (tmp_path / "out").exists()
