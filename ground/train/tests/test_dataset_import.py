"""The import of the public layout: frames that the check passes, targets on their pixels, nothing done twice."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from command import goshawk
from goshawk_train.config import Config
from goshawk_train.data import DataError, batches, layout
from goshawk_train.data.check.poses import target_in_camera
from goshawk_train.data.check.report import check
from goshawk_train.data.foreign import importer, yopo
from goshawk_train.data.foreign.ground import estimate_ground
from goshawk_train.data.foreign.resample import OURS, Intrinsics, Resampler
from goshawk_train.data.foreign.yopo import Format
from goshawk_train.data.layout import Bounds, alone
from goshawk_train.data.ply import read_ply, write_ply
from goshawk_train.model import geometry
from numpy.typing import NDArray
from PIL import Image
from synthetic import write_foreign

FRAMES = 12


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    root = tmp_path_factory.mktemp("foreign") / "dataset"
    write_foreign(root, scenes=2, frames=FRAMES, seed=7)
    return root


@pytest.fixture(scope="module")
def imported(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("imported") / "ours"
    importer.import_scenes(source, out, Format())
    return out


@pytest.fixture
def copy(source: Path, tmp_path: Path) -> Path:
    return shutil.copytree(source, tmp_path / "source")


def test_imported_scenes_pass_the_check(imported: Path) -> None:
    report = check(imported)
    assert report.findings == []
    assert report.figures()["frames"] == 2 * FRAMES


def test_imported_scenes_are_what_the_trainer_reads(imported: Path, config: Config) -> None:
    frames, maps = batches.load(imported, config)
    assert frames.rgb_FHW3[:].shape == (2 * FRAMES, 96, 160, 3)
    assert len(maps.base_S) == 2
    assert layout.describe(imported) == "ours: 2 scenes imported from dataset"


def test_targets_project_onto_the_person(imported: Path) -> None:
    """The synthetic person is red, and stands nowhere else."""
    seen = 0
    for folder in layout.scene_folders(imported):
        labels = layout.read_labels(folder / "labels.csv", 0)
        rgb, depth = layout.read_images(folder, len(labels), OURS)
        pos_cam = target_in_camera(labels)
        u, v = geometry.project(pos_cam, OURS)
        for f in np.flatnonzero(labels.visible_F > 0):
            row, column = int(v[f]), int(u[f])
            r, g, b = rgb[f, row, column].astype(int)
            assert r > g + 80 and r > b + 80, (folder.name, f, (r, g, b))
            near = depth[f, max(row - 2, 0) : row + 3, max(column - 1, 0) : column + 2]
            # The surface that faces the camera is a quarter of a metre before the centre.
            assert abs(np.median(near[near > 0]) / 1000 + 0.25 - pos_cam[f, 0]) < 0.3
            seen += 1
    assert seen >= 8


def test_images_are_paired_by_number(imported: Path, source: Path) -> None:
    """10.jpg comes after 2.jpg."""
    with Image.open(source / "scene-0" / "rgb" / "10.jpg") as image:
        tenth = Resampler(480, 270, Intrinsics.of(480, 270, np.pi / 2)).rgb(np.asarray(image))
    assert np.array_equal(np.load(imported / "scene_0000" / "rgb.npy")[10], tenth)


def test_an_import_keeps_finished_scenes(source: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    first = importer.import_scenes(source, out, Format())
    shutil.rmtree(out / "scene_0001")
    stamp = (out / "scene_0000" / "rgb.npy").stat().st_mtime_ns
    second = importer.import_scenes(source, out, Format())
    assert (first.imported, first.kept, second.imported, second.kept) == (2, 0, 1, 1)
    assert (out / "scene_0000" / "rgb.npy").stat().st_mtime_ns == stamp
    assert check(out).findings == []


def test_a_failed_scene_leaves_nothing_and_the_next_try_goes_on(copy: Path, tmp_path: Path) -> None:
    out, bad = tmp_path / "out", copy / "scene-1" / "depth" / "3.png"
    whole = bad.read_bytes()
    bad.write_bytes(whole[: len(whole) // 2])
    with pytest.raises(DataError, match=r"scene-1/depth/3\.png: not a readable image"):
        importer.import_scenes(copy, out, Format())
    assert sorted(p.name for p in out.iterdir()) == ["dataset.json", "scene_0000"]
    bad.write_bytes(whole)
    assert importer.import_scenes(copy, out, Format()).imported == 1


def test_two_imports_at_once_are_kept_apart(source: Path, tmp_path: Path) -> None:
    with alone(tmp_path / "out"), pytest.raises(DataError, match="another command fills it now"):
        importer.import_scenes(source, tmp_path / "out", Format())


def test_a_scene_of_another_name_is_named(source: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    importer.import_scenes(source, out, Format())
    (out / "scene_0001").rename(out / "scene_old")
    with pytest.raises(DataError, match="scene_old is none of the import's scenes"):
        importer.import_scenes(source, out, Format())


def test_other_options_are_refused_in_a_begun_data_set(source: Path, imported: Path) -> None:
    with pytest.raises(DataError, match="other origin or options"):
        importer.import_scenes(source, imported, Format(tilt_deg=10))


def test_other_conventions_are_converted(copy: Path, tmp_path: Path) -> None:
    """NED, attitudes of a camera with axes right, down, forward, in the order x, y, z, w, depth in centimetres."""
    folder = copy / "scene-0"
    shutil.rmtree(copy / "scene-1")
    form = Format(columns=("x", "y", "z", "qx", "qy", "qz", "qw", "target_x", "target_y", "target_z"))
    form = Format(columns=form.columns, world="ned", camera="rdf", depth_unit_mm=10.0)
    lines = (folder / "labels.csv").read_text().splitlines()[1:]
    table = np.array([[float(cell) for cell in line.split(",")] for line in lines])
    flip = np.diag([1.0, -1, -1])
    attitude = flip @ geometry.matrix_from_quaternion(table[:, 3:7]) @ yopo.CAMERAS["rdf"].T
    table[:, 3:7] = np.roll(geometry.quaternion_from_matrix(attitude), -1, axis=1)
    table[:, 0:3], table[:, 7:10] = table[:, 0:3] @ flip, table[:, 7:10] @ flip
    np.savetxt(folder / "labels.csv", table, delimiter=",", header=",".join(form.columns), comments="")
    points = read_ply(folder / "environment.ply").astype(np.float64) @ flip
    np.savetxt(folder / "points.txt", points)
    text = (folder / "points.txt").read_text()
    head = f"ply\nformat ascii 1.0\nelement vertex {len(points)}\n"
    head += "property double x\nproperty double y\nproperty double z\nend_header\n"
    (folder / "environment.ply").write_text(head + text)
    for path in (folder / "depth").iterdir():
        with Image.open(path) as image:
            coarse = np.rint(np.asarray(image) / 10).astype(np.uint16)
        Image.fromarray(coarse).save(path)
    importer.import_scenes(copy, tmp_path / "out", form)
    assert check(tmp_path / "out").findings == []


def test_a_wrong_convention_is_refused_by_name(copy: Path, tmp_path: Path) -> None:
    path = copy / "scene-0" / "labels.csv"
    lines = path.read_text().splitlines()
    rows = [line.split(",") for line in lines[1:]]
    swapped = [",".join([*row[:3], *row[4:7], row[3], "nan", "nan", "nan"]) for row in rows]
    path.write_text("\n".join(["a,b,c,d,e,f,g,h,i,j", *swapped]) + "\n")
    with pytest.raises(DataError, match=r"scene-0: .* if quaternions are \(x, y, z, w\): correct --columns"):
        importer.import_scenes(copy, tmp_path / "out", Format())


def test_a_head_that_contradicts_the_order_is_refused(copy: Path, tmp_path: Path) -> None:
    path = copy / "scene-0" / "labels.csv"
    path.write_text(path.read_text().replace("qw,qx,qy,qz", "qx,qy,qz,qw"))
    with pytest.raises(DataError, match="column 4 is qx, not qw: give the order with --columns"):
        importer.import_scenes(copy, tmp_path / "out", Format())


def test_targets_out_of_view_mean_wrong_attitudes(copy: Path, tmp_path: Path) -> None:
    with pytest.raises(DataError, match=r"targets lie outside of the view: correct --columns"):
        importer.import_scenes(copy, tmp_path / "out", Format(camera="rdf"))


def missing_cloud(scene: Path) -> None:
    (scene / "environment.ply").unlink()


def missing_row(scene: Path) -> None:
    path = scene / "labels.csv"
    path.write_text("\n".join(path.read_text().splitlines()[:-1]) + "\n")


def missing_depth(scene: Path) -> None:
    (scene / "depth" / "4.png").unlink()


def shallow_depth(scene: Path) -> None:
    path = scene / "depth" / "0.png"
    with Image.open(path) as image:
        coarse = (np.asarray(image) // 256).astype(np.uint8)
    Image.fromarray(coarse).save(path)


def missing_labels(scene: Path) -> None:
    (scene / "labels.csv").unlink()


def labels_of_another_alphabet(scene: Path) -> None:
    path = scene / "labels.csv"
    path.write_bytes(path.read_bytes() + b"\xff\xfe")


def ground_of_words(scene: Path) -> None:
    np.save(scene / "ground.npy", np.full((3, 4), "low"))
    (scene / "ground.json").write_text('{"cell_m": 10.0, "min_xy": [-15, -15]}')


def ground_of_no_size(scene: Path) -> None:
    np.save(scene / "ground.npy", np.zeros((3, 4)))
    (scene / "ground.json").write_text('{"cell_m": 0, "min_xy": [-15, -15]}')


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (labels_of_another_alphabet, r"scene-0/labels\.csv: not a table"),
        (ground_of_words, r"scene-0/ground\.npy: must be heights"),
        (ground_of_no_size, r"scene-0/ground\.json: must be"),
        (missing_cloud, r"scene-0/environment\.ply: No such file"),
        (missing_row, r"scene-0/labels\.csv: 11 rows for 12 images"),
        (missing_depth, r"scene-0/depth: no image number 4"),
        (shallow_depth, r"scene-0/depth/0\.png: depth must be a PNG of one channel of 16 bits"),
        (missing_labels, r"scene-0/labels\.csv: missing"),
    ],
)
def test_bad_source_is_named(copy: Path, tmp_path: Path, spoil: Callable[[Path], None], said: str) -> None:
    spoil(copy / "scene-0")
    with pytest.raises(DataError, match=said):
        importer.import_scenes(copy, tmp_path / "out", Format())


def without_ground(scene: Path) -> None:
    points = read_ply(scene / "environment.ply")
    write_ply(scene / "environment.ply", points[points[:, 2] > 0.08])


def test_a_cloud_without_ground_needs_one(copy: Path, tmp_path: Path) -> None:
    shutil.rmtree(copy / "scene-1")
    without_ground(copy / "scene-0")
    with pytest.raises(DataError, match=r"shows the ground in only \d+ % of its area: .* ground\.npy"):
        importer.import_scenes(copy, tmp_path / "out", Format())
    np.save(copy / "scene-0" / "ground.npy", np.zeros((3, 4), dtype=np.float32))
    with pytest.raises(DataError, match=r"ground\.json: No such file"):
        importer.import_scenes(copy, tmp_path / "out", Format())
    (copy / "scene-0" / "ground.json").write_text('{"cell_m": 10.0, "min_xy": [-15, -15]}')
    importer.import_scenes(copy, tmp_path / "out", Format())
    assert check(tmp_path / "out").findings == []


def test_too_narrow_a_camera_is_refused(source: Path, tmp_path: Path) -> None:
    done = goshawk("dataset", "import", source, "--out", tmp_path / "out", "--hfov-deg", 60)
    assert done.exit_code == 2
    assert "see only 57 % of our width" in done.stderr


@pytest.mark.parametrize(
    "wrong",
    [("--hfov-deg", "175"), ("--depth-unit-mm", "0"), ("--fx", "nan"), ("--fx", "300"), ("--columns", "x,y"),
     ("--world", "enu"), ("--camera", "flr")],
)  # fmt: skip
def test_an_option_that_cannot_be_is_wrong_usage(wrong: tuple[str, str], source: Path, tmp_path: Path) -> None:
    done = goshawk("dataset", "import", source, "--out", tmp_path / "out", *wrong)
    assert done.exit_code == 2 and "Error" in done.stderr
    assert not (tmp_path / "out").exists()


def test_columns_are_given_in_any_order(copy: Path, tmp_path: Path) -> None:
    done = goshawk("dataset", "import", copy, "--out", tmp_path / "out", "--columns", ", ".join(yopo.COLUMNS))
    assert done.exit_code == 0 and f"next: goshawk dataset check {tmp_path / 'out'}" in done.stdout


def test_resampling_keeps_the_optical_axis_and_the_field_of_view() -> None:
    """A bright pixel off the middle of a larger, shifted camera lands where its ray does."""
    camera = Intrinsics(fx=250.0, fy=245.0, cx=330.0, cy=180.0)
    rgb = np.zeros((360, 640, 3), dtype=np.uint8)
    depth = np.zeros((360, 640), dtype=np.uint16)
    y, z = -0.5, 0.25
    column, row = int(camera.cx - camera.fx * y), int(camera.cy - camera.fy * z)
    rgb[row - 2 : row + 3, column - 2 : column + 3] = 255
    depth[row - 2 : row + 3, column - 2 : column + 3] = 4321
    sampler = Resampler(640, 360, camera)
    u, v = geometry.project(np.array([1.0, y, z]), OURS)
    brightest = np.unravel_index(sampler.rgb(rgb)[..., 0].argmax(), (96, 160))
    assert abs(brightest[0] + 0.5 - v) <= 1 and abs(brightest[1] + 0.5 - u) <= 1
    assert sampler.depth(depth)[int(v), int(u)] == 4321
    assert sampler.covered[1] == 1.0


def test_what_the_source_does_not_see_has_no_depth() -> None:
    sampler = Resampler(480, 270, Intrinsics.of(480, 270, np.pi / 2))
    assert sampler.covered == (90 / 96, 1.0)
    depth = sampler.depth(np.full((270, 480), 1000, dtype=np.uint16))
    assert (depth[:3] == 0).all() and (depth[-3:] == 0).all() and (depth[3:-3] == 1000).all()
    assert (sampler.rgb(np.full((270, 480, 3), 77, dtype=np.uint8)) == 77).all()


def test_ground_is_found_under_trees_and_on_slopes() -> None:
    rng = np.random.default_rng(5)
    xy = rng.uniform(0, 30, (40_000, 2))

    def true(at: NDArray[np.float64]) -> NDArray[np.float64]:
        return 0.08 * at[:, 0] + 0.4 * np.sin(at[:, 1] / 5)

    hidden = np.hypot(xy[:, 0] - 15, xy[:, 1] - 15) < 2.5  # no ground seen under a thicket
    ground = np.column_stack([xy[~hidden], true(xy[~hidden]) + rng.normal(0, 0.02, int((~hidden).sum()))])
    thicket = np.column_stack([xy[hidden], true(xy[hidden]) + rng.uniform(0.8, 3.0, int(hidden.sum()))])
    trunks = np.repeat(rng.uniform(0, 30, (40, 2)), 200, axis=0) + rng.uniform(-0.2, 0.2, (8000, 2))
    trees = np.column_stack([trunks, true(trunks) + rng.uniform(0, 4, 8000)])
    stray = np.array([[7.0, 7.0, -6.0]])
    points = np.vstack([ground, thicket, trees, stray]).astype(np.float32)
    found, seen = estimate_ground(points, Bounds(min_xyz=np.array([0.0, 0, -7]), max_xyz=np.array([30.0, 30, 8])))
    probe = rng.uniform(1, 29, (2000, 2))
    error = np.abs(found.at(probe) - true(probe))
    assert np.percentile(error, 95) < 0.12
    assert error.max() < 0.5
    assert 0.9 < seen < 1.0
