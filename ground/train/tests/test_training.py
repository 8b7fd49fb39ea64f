"""Training as a whole on a tiny synthetic forest: it learns, resumes exactly, and exports what it trained."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import resource
import signal
from pathlib import Path
from typing import Any, cast

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
import torch.nn.functional as F
from command import goshawk
from goshawk_train.config import Config, replace_training
from goshawk_train.costs.esdf import SceneMaps
from goshawk_train.costs.trajectory import CostTerms
from goshawk_train.data import batches
from goshawk_train.model import checkpoint, export
from goshawk_train.model.card import CONTRACT_KEY
from goshawk_train.model.network import TRAJECTORY_CHANNELS, Policy
from goshawk_train.run import score, train, validate
from goshawk_train.run.beginning import Beginning, normalise, of_policy, of_run
from synthetic import write_config
from typer.testing import Result

SIMULATOR = Path(__file__).parents[3] / "target" / "release" / "goshawk-sim"
GOLDEN_LOSSES = [218.376, 256.404, 202.591, 190.028]


@pytest.fixture(scope="module")
def loaded(small: Config, dataset: Path) -> tuple[batches.Frames, SceneMaps]:
    return batches.load(dataset, small)


def trainer(config: Config, loaded: tuple[batches.Frames, SceneMaps]) -> train.Trainer:
    return train.Trainer(config, *loaded, data_name="synthetic")


def test_network_fits_a_few_frames(small: Config, loaded: tuple[batches.Frames, SceneMaps]) -> None:
    """Without augmentation; the states are new in each step, so it is no plain memory."""
    plain = dataclasses.replace(small.augment, hue_rad=0.0, saturation=0.0, value=0.0, noise=0.0)
    plain = dataclasses.replace(plain, blank_rgb=0.0, blank_depth=0.0, flip=0.0)
    training = replace_training(small, samples=8 * 60, learning_rate=8e-3, ema=0.9)
    able = dataclasses.replace(small.sampling, agility_full=1.0)
    run = trainer(dataclasses.replace(training, augment=plain, sampling=able), loaded)
    parts = [{name: float(value) for name, value in run.advance().items()} for _ in range(60)]
    shares = {"loss": 0.88, "cost_error": 0.85, "objectness": 0.85, "target": 0.93}
    for name, share in shares.items():
        early, late = (np.mean([p[name] for p in part]) for part in (parts[:6], parts[-18:]))
        assert late < share * early, f"{name}: {early:.3f} -> {late:.3f}"


@pytest.mark.parametrize(("able", "kind"), [({"avx512_bf16": True}, torch.bfloat16), ({"avx2": True}, torch.float32)])
def test_bfloat16_is_computed_with_only_where_the_processor_has_instructions_for_it(
    able: dict[str, bool],
    kind: torch.dtype,
    small: Config,
    loaded: tuple[batches.Frames, SceneMaps],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: able)
    training, seen = trainer(small, loaded), list[torch.dtype]()
    features = training.network.features

    def watched(rgbd_I4HW: torch.Tensor) -> torch.Tensor:
        found = features(rgbd_I4HW)
        seen.append(found.dtype)
        return found

    monkeypatch.setattr(training.network, "features", watched)
    training.advance()
    assert small.training.bf16 and seen == [kind]


def test_resumed_run_repeats_the_uninterrupted_one(
    small: Config, loaded: tuple[batches.Frames, SceneMaps], tmp_path: Path
) -> None:
    torch.use_deterministic_algorithms(True)
    try:
        whole = trainer(small, loaded)
        expected = [float(whole.advance()["loss"]) for _ in range(8)]
        first = trainer(small, loaded)
        begun = [float(first.advance()["loss"]) for _ in range(4)]
        checkpoint.save(tmp_path / "c.pt", first.snapshot())
        second = trainer(small, loaded)
        second.restore(checkpoint.load(tmp_path / "c.pt"))
        assert begun + [float(second.advance()["loss"]) for _ in range(4)] == expected
        for name, value in whole.snapshot().ema.items():
            assert torch.equal(value, second.snapshot().ema[name]), name
    finally:
        torch.use_deterministic_algorithms(False)


def beginning(run: train.Trainer, folder: Path) -> Beginning:
    checkpoint.save(folder / checkpoint.FILE, run.snapshot())
    return of_run(folder / checkpoint.FILE)


def test_run_begins_with_another_runs_averaged_weights(
    small: Config, loaded: tuple[batches.Frames, SceneMaps], tmp_path: Path
) -> None:
    first = train.Trainer(small, *loaded, data_name="a")
    for _ in range(3):
        first.advance()
    second = train.Trainer(replace_training(small, learning_rate=1e-4), *loaded, data_name="b")
    second.begin_from(beginning(first, tmp_path))
    assert second.step == 0
    for name, value in second.snapshot().network.items():
        if value.is_floating_point():
            assert torch.equal(value, first.ema.state_dict()[name]), name
    assert "samples of a" in second.snapshot().data


def test_a_navigation_begins_with_a_chases_trajectories_and_a_chase_with_a_navigations(
    small: Config, loaded: tuple[batches.Frames, SceneMaps], tmp_path: Path
) -> None:
    chase = train.Trainer(small, *loaded, data_name="a")
    chase.advance()
    navigation = train.Trainer(dataclasses.replace(small, task="navigate"), *loaded, data_name="b")
    navigation.begin_from(beginning(chase, tmp_path))
    again = train.Trainer(dataclasses.replace(small, seed=2), *loaded, data_name="c")
    fresh = {name: value.clone() for name, value in again.network.state_dict().items()}
    again.begin_from(beginning(navigation, tmp_path))
    lent = {**chase.network.state_dict(), **chase.ema.state_dict()}
    for name, value in again.network.state_dict().items():
        if name.startswith("out."):
            lent[name] = torch.cat([lent[name][:TRAJECTORY_CHANNELS], fresh[name][TRAJECTORY_CHANNELS:]])
        if value.is_floating_point():
            assert torch.equal(value, lent[name]), name


def test_a_network_of_other_widths_is_nothing_to_begin_from(
    small: Config, loaded: tuple[batches.Frames, SceneMaps], tmp_path: Path
) -> None:
    first = train.Trainer(small, *loaded, data_name="a")
    network = dataclasses.replace(small.network, head_channels=small.network.head_channels + 1)
    second = train.Trainer(dataclasses.replace(small, network=network), *loaded, data_name="b")
    with pytest.raises(train.TrainingError, match="same widths"):
        second.begin_from(beginning(first, tmp_path))


def test_a_policys_file_is_gone_on_with_as_if_never_folded(
    small: Config, loaded: tuple[batches.Frames, SceneMaps], tmp_path: Path
) -> None:
    first = trainer(small, loaded)
    for _ in range(12):
        first.advance()
    export.export(first.snapshot(), tmp_path / "track.onnx", commit="", cost_scale=6.5)
    second = train.Trainer(small, *loaded, data_name="b")
    second.begin_from(of_policy(tmp_path / "track.onnx"))
    assert "96 samples of synthetic" in second.snapshot().data
    network = second.network.eval()
    assert export.verify(network, tmp_path / "track.onnx", small) < export.AGREEMENT
    images = torch.tensor(loaded[0].rgb_FHW3[:] / 255.0, dtype=torch.float32).permute(0, 3, 1, 2)
    rgbd = F.pad(images, (0, 0, 0, 0, 0, 1), value=0.5)
    normalise(network, rgbd)
    with torch.no_grad():
        flies = network.features(rgbd)
        trains = network.train().features(rgbd)
    torch.testing.assert_close(flies, trains, rtol=1e-2, atol=1e-2)


def policy_of_another_state() -> bytes:
    """A file whose contract is whole but for a state that nobody knows."""
    model = onnx.ModelProto()
    contract = {"state": ["velocity", "gravity"], "training": {"samples": 1, "data": "a"}}
    model.metadata_props.add(key=CONTRACT_KEY, value=json.dumps(contract))
    return model.SerializeToString()


@pytest.mark.parametrize(
    "content", [None, b"", b"no model", onnx.ModelProto().SerializeToString(), policy_of_another_state()]
)
def test_a_file_that_is_no_policy_of_ours_is_one_line(
    content: bytes | None, small: Config, dataset: Path, tmp_path: Path
) -> None:
    file = tmp_path / "policy.onnx"
    if content is not None:
        file.write_bytes(content)
    config = write_config(small, tmp_path)
    run = tmp_path / "run"
    done = goshawk("train", "run", "--config", config, "--data", dataset, "--out", run, "--from", file)
    assert done.exit_code == 2
    assert done.stderr.count("\n") == 1 and str(file) in done.stderr


def test_checkpoint_of_another_configuration_is_refused(
    small: Config, loaded: tuple[batches.Frames, SceneMaps]
) -> None:
    saved = trainer(small, loaded).snapshot()
    other = trainer(dataclasses.replace(small, seed=2), loaded)
    with pytest.raises(train.TrainingError, match="another configuration"):
        other.restore(saved)


def test_checkpoint_of_other_data_is_refused_whatever_it_was_begun_from(
    small: Config, loaded: tuple[batches.Frames, SceneMaps]
) -> None:
    saved = dataclasses.replace(trainer(small, loaded).snapshot(), data="synthetic, begun from 8 samples of a")
    same = trainer(small, loaded)
    same.restore(saved)
    assert same.snapshot().data == saved.data
    for name in ("synthetic; b", "a", "synth"):
        other = train.Trainer(small, *loaded, data_name=name)
        with pytest.raises(train.TrainingError, match=f"made with synthetic, .*, not with {name}; use that data"):
            other.restore(saved)


def test_torn_checkpoint_is_named(tmp_path: Path) -> None:
    path = tmp_path / "checkpoint.pt"
    path.write_bytes(b"half a file")
    with pytest.raises(checkpoint.CheckpointError, match=r"checkpoint\.pt"):
        checkpoint.load(path)


@pytest.mark.parametrize("content", [[1, 2], {"format": 0}])
def test_a_file_of_torch_that_is_no_checkpoint_is_named(content: object, tmp_path: Path) -> None:
    torch.save(content, tmp_path / "checkpoint.pt")
    with pytest.raises(checkpoint.CheckpointError, match=r"checkpoint\.pt"):
        checkpoint.load(tmp_path / "checkpoint.pt")


def test_a_full_disk_leaves_the_checkpoint_as_it_was(
    small: Config, loaded: tuple[batches.Frames, SceneMaps], tmp_path: Path
) -> None:
    path, saved = tmp_path / "checkpoint.pt", trainer(small, loaded).snapshot()
    checkpoint.save(path, saved)
    before = path.read_bytes()
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    handled = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (len(before) // 2, hard))  # no file may be longer, as on a full disk
    try:
        with pytest.raises((checkpoint.CheckpointError, OSError)):
            checkpoint.save(path, saved)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        signal.signal(signal.SIGXFSZ, handled)
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


def test_a_run_that_is_not_there_is_one_line_that_says_how_it_is_made(tmp_path: Path) -> None:
    empty, file, missing = tmp_path / "empty", tmp_path / "file", tmp_path / "missing"
    empty.mkdir()
    file.touch()

    def refused(run: Path) -> str:
        done = goshawk("train", "export", "--run", run, "--data", tmp_path, "--out", tmp_path / "policy.onnx")
        assert done.exit_code == 2, done.output
        (line,) = done.output.splitlines()
        return line.partition(": ")[2]

    makes = "name that of a run; `goshawk train run --out {}` makes one"
    assert refused(missing) == f"there is no folder {missing}: {makes.format(missing)}"
    assert refused(empty) == f"the folder {empty} holds no checkpoint.pt: {makes.format(empty)}"
    assert refused(file) == f"{file} is no folder: name that of a run, in which its checkpoint.pt lies"


def test_schedule_warms_up_and_ends_at_one_percent() -> None:
    rates = [train.learning_rate(s, total=1000, warm_up=100, peak=1e-3, final_fraction=0.01) for s in range(1001)]
    assert rates[0] == pytest.approx(1e-5)
    assert max(rates) == pytest.approx(1e-3)
    assert rates[100:] == sorted(rates[100:], reverse=True)
    assert rates[-1] == pytest.approx(1e-5)


def test_epochs_visit_every_frame_once() -> None:
    for epoch in range(3):
        assert sorted(batches.epoch_order(50, seed=1, epoch=epoch)) == list(range(50))
    assert not np.array_equal(batches.epoch_order(50, seed=1, epoch=0), batches.epoch_order(50, seed=1, epoch=1))


def test_exported_policy_carries_the_contract_and_agrees_with_torch(
    small: Config, loaded: tuple[batches.Frames, SceneMaps], tmp_path: Path
) -> None:
    run = trainer(small, loaded)
    for _ in range(3):
        run.advance()
    path = tmp_path / "track.onnx"
    export.export(run.snapshot(), path, commit="abc", cost_scale=6.5)
    model = onnx.load(str(path))
    assert [p.key for p in model.metadata_props] == [CONTRACT_KEY]
    agreed = json.loads(model.metadata_props[0].value)
    assert (agreed["version"], agreed["task"], agreed["cost_scale"]) == (2, "track", 6.5)
    assert agreed["state"] == ["velocity", "acceleration", "up", "aim", "agility"]
    assert agreed["channels"][9:] == ["cost", "objectness", "du", "dv", "distance"]
    assert agreed["training"] == {**agreed["training"], "data": "synthetic", "commit": "abc", "seed": 1, "samples": 24}
    session = cast("Any", onnxruntime).InferenceSession(str(path), providers=["CPUExecutionProvider"])
    assert [(i.name, i.shape) for i in session.get_inputs()] == [("rgbd", [1, 4, 96, 160]), ("state", [1, 13])]
    assert [(o.name, o.shape) for o in session.get_outputs()] == [("prediction", [1, 14, 3, 5])]
    assert str(Path.home()) not in path.read_bytes().decode("latin-1")

    other = Policy(small).eval()
    with pytest.raises(export.ExportError, match="differs"):
        export.verify(other, path, small)


def test_a_tracking_run_exports_its_trajectories_for_navigation(
    small: Config, loaded: tuple[batches.Frames, SceneMaps], tmp_path: Path
) -> None:
    run = trainer(small, loaded)
    run.advance()
    path = tmp_path / "navigate.onnx"
    agreed = export.export(export.for_navigation(run.snapshot()), path, commit="abc", cost_scale=6.5)
    assert (agreed["task"], len(agreed["channels"])) == ("navigate", 10)
    whole = Policy(small).eval()
    checkpoint.load_weights(whole, run.snapshot())
    rgbd, state = export.example_inputs(small, 5)
    session = cast("Any", onnxruntime).InferenceSession(str(path), providers=["CPUExecutionProvider"])
    got = session.run(None, {"rgbd": rgbd.numpy(), "state": state.numpy()})[0]
    with torch.no_grad():
        np.testing.assert_allclose(np.asarray(got), whole(rgbd, state)[:, :10].numpy(), rtol=1e-4, atol=1e-5)


def test_the_costs_logged_are_the_parts_of_the_trajectorys_and_all_of_them(
    small: Config, loaded: tuple[batches.Frames, SceneMaps]
) -> None:
    parts = trainer(small, loaded).advance()
    names = {name.removesuffix("_BN") for name in CostTerms.__dataclass_fields__} - {"min_distance", "pos_rel_BNK3"}
    assert set(parts) >= names and len(names) == 8
    torch.testing.assert_close(torch.stack([parts[name] for name in names]).sum(), parts["trajectory"])


def test_validation_measures_detection_collisions_and_cost_ranking(
    small: Config, dataset: Path, loaded: tuple[batches.Frames, SceneMaps]
) -> None:
    validator = validate.Validator(small, dataset)
    first = validator.evaluate_state(trainer(small, loaded).snapshot())
    again = validator.evaluate_state(trainer(small, loaded).snapshot())
    assert first == again
    for name in ("recall", "false_alarm_cell", "collide_cheapest", "cost_rank", "lateral_error_p95", "term_safety"):
        assert name in first
    assert first["recall"] == 0 and 0 < first["collide_all"] < 1


def test_command_line_trains_stops_and_resumes(small: Config, dataset: Path, tmp_path: Path) -> None:
    config = write_config(small, tmp_path)
    out = tmp_path / "run"
    common = ["train", "run", "--config", config, "--data", dataset, "--out", out, "--samples", 24]
    assert goshawk(*common).exit_code == 0
    assert checkpoint.load(out / checkpoint.FILE).step == 3
    assert goshawk(*common).exit_code == 2, "an existing run is not overwritten"
    assert goshawk(*common, "--resume").exit_code == 0
    policy = tmp_path / "models" / "track.onnx"
    assert goshawk("train", "export", "--run", out, "--data", dataset, "--out", policy).exit_code == 0
    card = policy.with_suffix(".md").read_text()
    assert policy.is_file() and "recall" in card and checkpoint.load(out / checkpoint.FILE).hardware in card
    assert hashlib.sha256(policy.read_bytes()).hexdigest() in card
    assert train.ALONE.hardware().endswith(("thread", "threads"))
    measured = goshawk("train", "validate", "--run", out, "--data", dataset, "--json", tmp_path / "m.json")
    assert measured.exit_code == 0 and measured.stdout.startswith("step 3, 24 samples\n")
    assert "recall" in json.loads((tmp_path / "m.json").read_text())
    preview = ["train", "preview", "--run", out, "--data", dataset, "--out", tmp_path / "picture"]
    assert goshawk(*preview).exit_code == 0
    assert (tmp_path / "picture").read_bytes().startswith(b"\x89PNG")
    many = goshawk(*preview, "--count", 1000)
    assert (many.exit_code, many.stderr.count("\n")) == (2, 1) and "has 24 frames, not 1000" in many.stderr


def test_navigation_trains_without_a_target(navigate: Config, small: Config, dataset: Path) -> None:
    config = dataclasses.replace(navigate, training=small.training, network=small.network)
    run = trainer(config, batches.load(dataset, config))
    losses = [run.advance() for _ in range(30)]
    assert np.mean([float(p["loss"]) for p in losses[-5:]]) < np.mean([float(p["loss"]) for p in losses[:5]])
    metrics = validate.Validator(config, dataset).evaluate_state(run.snapshot())
    assert "term_goal" in metrics and "recall" not in metrics


def test_first_losses_are_those_written_down(small: Config, loaded: tuple[batches.Frames, SceneMaps]) -> None:
    """A change of costs, sampling or network shows here. Where one is meant, the new ones are written down."""
    run = trainer(small, loaded)
    losses = [float(run.advance()["loss"]) for _ in range(4)]
    np.testing.assert_allclose(losses, GOLDEN_LOSSES, rtol=5e-3)


def test_score_flies_campaigns_in_both_tasks(
    small: Config, loaded: tuple[batches.Frames, SceneMaps], dataset: Path, tmp_path: Path
) -> None:
    run, held_out = trainer(small, loaded), validate.Validator(small, dataset)
    run.advance()
    shares = score.score(run.snapshot(), SIMULATOR, held_out, trials=1, threads=1)
    assert set(shares) == {"track_4", "track_7", "navigate_6", "navigate_10", "all"}
    assert all(0 <= share <= 1 for share in shares.values())
    with pytest.raises(score.ScoreError, match="make build"):
        score.score(run.snapshot(), tmp_path / "nothing", held_out)


def stub(folder: Path, *lines: str) -> Path:
    """A simulator that does this instead of flying."""
    path = folder / "goshawk-sim"
    path.write_text("\n".join(["#!/bin/sh", *lines, ""]))
    path.chmod(0o755)
    return path


def scored(small: Config, dataset: Path, folder: Path, simulator: Path) -> Result:
    """A run of two steps that is scored after each."""
    files = ["--config", write_config(small, folder), "--data", dataset, "--validation", dataset]
    often = ["--samples", 16, "--simulator", simulator, "--score-minutes", 0]
    return goshawk("train", "run", *files, "--out", folder / "run", *often)


def test_a_score_that_fails_is_one_line_after_the_checkpoint_and_the_training_goes_on(
    small: Config, dataset: Path, tmp_path: Path
) -> None:
    run, seen = tmp_path / "run" / checkpoint.FILE, tmp_path / "seen"
    simulator = stub(tmp_path, f"test -f {run} && echo saved >> {seen}", "echo 'no forest' >&2", "exit 1")
    done = scored(small, dataset, tmp_path, simulator)
    assert done.exit_code == 0 and checkpoint.load(run).step == 2
    told = [line for line in done.stderr.splitlines() if "torch" not in line]  # it tells of the export
    words = f"{simulator} fly --task track failed: no forest"
    assert told == [f"no score at step {step}: {words}" for step in (1, 2)]
    assert seen.read_text() == "saved\n" * 2


@pytest.mark.parametrize("ending", ["exec sleep 600", "exit 130"])
def test_ctrl_c_while_a_score_is_flown_ends_it_saves_and_ends(
    ending: str, small: Config, dataset: Path, tmp_path: Path
) -> None:
    """Whether it reaches the simulator too, as from a terminal, or not."""
    done = scored(small, dataset, tmp_path, stub(tmp_path, "kill -INT $PPID", ending))
    saved = tmp_path / "run" / checkpoint.FILE
    assert done.exit_code == 130 and checkpoint.load(saved).step == 1
    assert "no score" not in done.stderr
    assert done.stderr.splitlines()[-1] == f"stopped at step 1; {saved} is written, go on with --resume"


def test_the_cost_scale_grows_as_the_costs_and_equal_costs_are_not_exported(
    small: Config, loaded: tuple[batches.Frames, SceneMaps], dataset: Path, tmp_path: Path
) -> None:
    run, held_out = trainer(small, loaded), validate.Validator(small, dataset)
    run.advance()
    saved = run.snapshot()
    metrics = held_out.evaluate_state(saved)
    assert held_out.cost_scale(saved) == pytest.approx(metrics["cost_spread_p50"], rel=5e-3)
    assert metrics["cost_spread_p50"] > 0
    with pytest.raises(export.ExportError, match="train for longer"):
        export.export(saved, tmp_path / "track.onnx", commit="", cost_scale=0.0)


def test_a_run_that_is_to_be_scored_needs_held_out_scenes(small: Config, dataset: Path, tmp_path: Path) -> None:
    with pytest.raises(train.TrainingError, match="--validation"):
        train.run(small, dataset, tmp_path / "run", train.RunOptions(simulator=SIMULATOR))
