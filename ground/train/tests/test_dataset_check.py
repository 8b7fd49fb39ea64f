"""The check before training: a good data set passes, and each kind of damage is found and named."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command import goshawk
from goshawk_train.data import layout, ply
from goshawk_train.data.check.findings import Finding
from goshawk_train.data.check.report import check
from goshawk_train.model import geometry

SCENE = "scene_0001"


@pytest.fixture
def copy(dataset: Path, tmp_path: Path) -> Path:
    return shutil.copytree(dataset, tmp_path / "copy")


def edit_array(folder: Path, name: str, change: Callable[[np.ndarray], None]) -> None:
    array = np.load(folder / name)
    change(array)
    np.save(folder / name, array)


def edit_labels(folder: Path, change: Callable[[list[dict[str, str]]], None]) -> None:
    lines = (folder / "labels.csv").read_text().splitlines()
    names = lines[0].split(",")
    rows = [dict(zip(names, line.split(","), strict=True)) for line in lines[1:]]
    change(rows)
    text = [lines[0], *(",".join(row[name] for name in names) for row in rows)]
    (folder / "labels.csv").write_text("\n".join(text) + "\n")


def move_camera(row: dict[str, str], pos: np.ndarray) -> None:
    row.update(zip("xyz", (f"{c:.4f}" for c in pos), strict=True))


def frame_with(folder: Path, *, visible: bool) -> int:
    """The first frame whose target is in view, near, and seen or hidden."""
    labels = layout.read_labels(folder / "labels.csv", 0)
    pos_cam = np.einsum("fji,fj->fi", labels.world_from_cam_F33, labels.target_world_F3 - labels.pos_world_F3)
    right = labels.has_target_F & ((labels.visible_F > 0.95) if visible else (labels.visible_F == 0))
    return int(np.flatnonzero(right & (pos_cam[:, 0] > 1))[0])


def black_image(folder: Path) -> None:
    edit_array(folder, "rgb.npy", lambda a: a[3].fill(0))


def grey_image(folder: Path) -> None:
    edit_array(folder, "rgb.npy", lambda a: a[3].fill(120))


def white_image(folder: Path) -> None:
    def change(rgb: np.ndarray) -> None:
        rgb[3, :80] = 255

    edit_array(folder, "rgb.npy", change)


def constant_depth(folder: Path) -> None:
    edit_array(folder, "depth.npy", lambda a: a[3].fill(3000))


def no_depth(folder: Path) -> None:
    edit_array(folder, "depth.npy", lambda a: a[3].fill(0))


def copied_image(folder: Path) -> None:
    def change(rgb: np.ndarray) -> None:
        rgb[3] = rgb[0]
        rgb[4] = rgb[0]

    edit_array(folder, "rgb.npy", change)


def pose_in_obstacle(folder: Path) -> None:
    inside = ply.read_ply(folder / "environment.ply")
    edit_labels(folder, lambda rows: move_camera(rows[3], inside[np.abs(inside[:, 2] - 1.5).argmin()]))


def pose_under_ground(folder: Path) -> None:
    edit_labels(folder, lambda rows: rows[3].update(z="-0.4"))


def pose_outside(folder: Path) -> None:
    edit_labels(folder, lambda rows: rows[3].update(x="60"))


def long_quaternion(folder: Path) -> None:
    edit_labels(folder, lambda rows: rows[3].update({f"q{c}": str(2 * float(rows[3][f"q{c}"])) for c in "wxyz"}))


def other_ground(folder: Path) -> None:
    edit_labels(folder, lambda rows: rows[3].update(ground_z="0.7"))


def visible_in_percent(folder: Path) -> None:
    edit_labels(folder, lambda rows: rows[frame_with(folder, visible=True)].update(visible="98"))


def hidden_marked_visible(folder: Path) -> None:
    edit_labels(folder, lambda rows: rows[frame_with(folder, visible=False)].update(visible="1.0"))


def seen_marked_hidden(folder: Path) -> None:
    edit_labels(folder, lambda rows: rows[frame_with(folder, visible=True)].update(visible="0.0"))


def target_elsewhere(folder: Path) -> None:
    def change(rows: list[dict[str, str]]) -> None:
        row = rows[frame_with(folder, visible=True)]
        row["target_z"] = "9.0"

    edit_labels(folder, change)


def truncated(folder: Path) -> None:
    path = folder / "depth.npy"
    path.write_bytes(path.read_bytes()[:-1000])


def wrong_type(folder: Path) -> None:
    np.save(folder / "depth.npy", np.load(folder / "depth.npy").astype(np.float32))


def fewer_labels(folder: Path) -> None:
    def change(rows: list[dict[str, str]]) -> None:
        del rows[-1]

    edit_labels(folder, change)


def empty_box(folder: Path) -> None:
    path = folder / "scene.json"
    meta = json.loads(path.read_text())
    path.write_text(json.dumps(meta | {"max_xyz": meta["min_xyz"]}))


def missing_file(folder: Path) -> None:
    (folder / "environment.ply").unlink()


def endless_point(folder: Path) -> None:
    points = ply.read_ply(folder / "environment.ply")
    points[5, 1] = np.nan
    ply.write_ply(folder / "environment.ply", points)


def words_for_heights(folder: Path) -> None:
    np.save(folder / "ground.npy", np.full((4, 4), "low"))


def several_arrays(folder: Path) -> None:
    with (folder / "ground.npy").open("wb") as file:
        np.savez(file, heights=np.zeros((4, 4)))


def labels_of_another_alphabet(folder: Path) -> None:
    path = folder / "labels.csv"
    path.write_bytes(path.read_bytes() + b"\xff\xfe")


DAMAGES: list[tuple[Callable[[Path], None], str]] = [
    (black_image, "image-black"),
    (grey_image, "image-constant"),
    (white_image, "image-overexposed"),
    (constant_depth, "depth-constant"),
    (no_depth, "depth-blank"),
    (copied_image, "copies"),
    (pose_in_obstacle, "pose-in-obstacle"),
    (pose_under_ground, "pose-under-ground"),
    (pose_outside, "pose-outside-map"),
    (long_quaternion, "quaternion"),
    (other_ground, "ground-differs"),
    (visible_in_percent, "visible-range"),
    (hidden_marked_visible, "target-occluded"),
    (seen_marked_hidden, "target-unmarked"),
    (target_elsewhere, "target-out-of-view"),
    (truncated, "file-broken"),
    (wrong_type, "file-broken"),
    (fewer_labels, "file-broken"),
    (empty_box, "file-broken"),
    (endless_point, "file-broken"),
    (words_for_heights, "file-broken"),
    (several_arrays, "file-broken"),
    (labels_of_another_alphabet, "file-broken"),
    (missing_file, "file-missing"),
]


def errors(root: Path) -> list[Finding]:
    return check(root).errors


def test_good_data_pass(dataset: Path) -> None:
    report = check(dataset)
    assert report.findings == []
    figures = report.figures()
    assert (figures["scenes"], figures["frames"]) == (2, 24)
    assert figures["map_median_m"] < 0.15 and figures["map_beyond"] < 0.12


@pytest.mark.parametrize(("damage", "kind"), DAMAGES, ids=lambda value: getattr(value, "__name__", None))
def test_damage_is_named(copy: Path, damage: Callable[[Path], None], kind: str) -> None:
    damage(copy / SCENE)
    found = errors(copy)
    assert {(f.kind, f.where) for f in found} == {(kind, SCENE)}
    line = found[0].line()
    assert line.startswith(f"error: {SCENE}: ") and " → " in line
    if kind.startswith(("image", "depth", "pose", "quaternion", "ground")):
        assert found[0].frames == (3,) and "frame 3: " in line


def depth_in_metres(folder: Path) -> None:
    edit_array(folder, "depth.npy", lambda a: np.copyto(a, np.rint(a / 1000).astype(np.uint16)))


def depth_in_tenths(folder: Path) -> None:
    edit_array(folder, "depth.npy", lambda a: np.copyto(a, np.where(a < 6553, a, 0) * 10, casting="unsafe"))


def depth_along_rays(folder: Path) -> None:
    view = layout.read_view(folder.parent)
    factor = np.linalg.norm(geometry.pixel_rays(view), axis=-1)
    edit_array(folder, "depth.npy", lambda a: np.copyto(a, a * factor, casting="unsafe"))


def map_flipped(folder: Path) -> None:
    path = folder / "environment.ply"
    ply.write_ply(path, ply.read_ply(path) * np.array([1, -1, 1], dtype=np.float32))


def images_flipped(folder: Path) -> None:
    for name in ("rgb.npy", "depth.npy"):
        edit_array(folder, name, lambda a: np.copyto(a, a[:, :, ::-1].copy()))


def vector_first(folder: Path) -> None:
    def change(rows: list[dict[str, str]]) -> None:
        for row in rows:
            w, x, y, z = (row[f"q{c}"] for c in "wxyz")
            row.update(qw=x, qx=y, qy=z, qz=w)

    edit_labels(folder, change)


def heads_swapped(folder: Path) -> None:
    path = folder / "labels.csv"
    path.write_text(path.read_text().replace("qw,qx,qy,qz", "qx,qy,qz,qw"))


def tilt_forgotten(folder: Path) -> None:
    """Attitudes of a vehicle whose camera looks 20 deg up."""

    def change(rows: list[dict[str, str]]) -> None:
        quaternion = np.array([[float(row[f"q{c}"]) for c in "wxyz"] for row in rows])
        body = geometry.matrix_from_quaternion(quaternion) @ geometry.rotation_y(np.radians(20.0))
        for row, q in zip(rows, geometry.quaternion_from_matrix(body), strict=True):
            row.update({f"q{c}": f"{v:.7f}" for c, v in zip("wxyz", q, strict=True)})

    edit_labels(folder, change)


def rows_shifted(folder: Path) -> None:
    for name in ("rgb.npy", "depth.npy"):
        edit_array(folder, name, lambda a: np.copyto(a, np.roll(a, -1, axis=0)))


@pytest.mark.parametrize(
    ("mistake", "named"),
    [
        (depth_in_metres, "depth is in metres"),
        (depth_in_tenths, "depth is in tenths of a millimetre"),
        (depth_along_rays, "depth is the distance from the lens"),
        (map_flipped, "the map's y is flipped"),
        (images_flipped, "images are flipped left to right"),
        (vector_first, "quaternions are (x, y, z, w)"),
        (heads_swapped, "(w, x, y, z) under the heads qx, qy, qz, qw"),
        (tilt_forgotten, "the camera is pitched up by about 20 deg"),
        (rows_shifted, "images are one row ahead of their labels"),
    ],
)
def test_a_mistake_of_convention_is_recognised(copy: Path, mistake: Callable[[Path], None], named: str) -> None:
    for scene in ("scene_0000", SCENE):
        mistake(copy / scene)
    found = [f for f in errors(copy) if f.kind == "map-disagrees"]
    assert len(found) == 2
    assert all(named in f.what for f in found), [f.line() for f in found]


def test_a_scene_in_both_data_sets_is_a_leak(dataset: Path, copy: Path) -> None:
    shutil.rmtree(copy / "scene_0000")
    found = check(dataset, against=copy).errors
    assert [(f.kind, f.where) for f in found] == [("leak", SCENE)]
    assert f"the same map and poses as {SCENE} of {copy}" in found[0].what


def test_an_interrupted_data_set_is_noticed(copy: Path) -> None:
    shutil.rmtree(copy / "scene_0000")
    assert [f.line() for f in check(copy).findings] == [
        "warning: copy: 1 scenes, dataset.json says 2 → "
        "let the command that makes the data set finish: it goes on where it stopped"
    ]


def test_command_prints_findings_a_table_and_a_picture(copy: Path) -> None:
    black_image(copy / SCENE)
    done = goshawk("dataset", "check", copy, "--json", copy / "report.json")
    assert done.exit_code == 1
    assert done.stdout.startswith(f"error: {SCENE}: frame 3: the image is black → ")
    assert done.stdout.splitlines()[-2].split() == ["errors", "1"]
    assert (copy / "contact-sheet.png").read_bytes().startswith(b"\x89PNG")
    report = json.loads((copy / "report.json").read_text())
    assert report["findings"][0]["kind"] == "image-black" and report["findings"][0]["frames"] == [3]
    assert sum(map(sum, report["histograms"]["image"])) > 0


def test_no_data_set_is_one_line_and_status_2(tmp_path: Path) -> None:
    done = goshawk("dataset", "check", tmp_path)
    assert done.exit_code == 2
    assert done.stderr.startswith(f"goshawk dataset check: {tmp_path} holds no dataset.json")
    assert done.stderr.count("\n") == 1


def test_the_check_needs_no_torch(tmp_path: Path) -> None:
    code = "import sys; from goshawk_ground.cli import app\n"
    code += "try: app(sys.argv[1:])\nfinally: print('torch' in sys.modules)"
    command = [sys.executable, "-c", code, "dataset", "check", str(tmp_path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=120)
    assert (done.returncode, done.stdout) == (2, "False\n")
