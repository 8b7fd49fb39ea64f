"""A policy in 8 bits answers as before, is smaller, and can be begun from."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import onnx
import pytest
from command import goshawk
from goshawk_train.config import load_config
from goshawk_train.model.card import CONTRACT_KEY
from goshawk_train.run import quantise
from goshawk_train.run.beginning import of_policy

ROOT = Path(__file__).parents[3]
MODELS = ROOT / "air/models"
FRAMES = 10


@pytest.fixture(scope="module")
def small(tmp_path_factory: pytest.TempPathFactory, dataset: Path) -> tuple[Path, quantise.Agreement]:
    out = tmp_path_factory.mktemp("policies") / "track-8bit.onnx"
    return out, quantise.quantise(MODELS / "track-32bit.onnx", dataset, out, frames=FRAMES)


def test_its_answers_are_nearly_those_of_before_and_its_contract_is_the_same(
    small: tuple[Path, quantise.Agreement],
) -> None:
    out, agreement = small
    assert agreement.images == agreement.calibrated == FRAMES
    assert 0 < max(agreement.differences.values()) < quantise.MOST
    before, after = (onnx.load(str(path)) for path in (MODELS / "track-32bit.onnx", out))
    assert list(before.metadata_props) == list(after.metadata_props)
    assert out.stat().st_size < 0.4 * (MODELS / "track-32bit.onnx").stat().st_size


def test_the_head_stays_in_32_bits(small: tuple[Path, quantise.Agreement]) -> None:
    weights = {weight.name: weight for weight in onnx.load(str(small[0])).graph.initializer}
    before = {weight.name: weight for weight in onnx.load(str(MODELS / "track-32bit.onnx")).graph.initializer}
    for name in quantise.HEAD:
        assert weights[name] == before[name]
    assert weights["stem.0.weight_quantized"].data_type == onnx.TensorProto.INT8
    assert np.abs(onnx.numpy_helper.to_array(weights["stem.0.weight_quantized"])).max() < 128 // 2 + 1


def test_a_run_can_begin_with_it(small: tuple[Path, quantise.Agreement]) -> None:
    before, after = of_policy(MODELS / "track-32bit.onnx"), of_policy(small[0])
    assert before.weights.keys() == after.weights.keys() and before.origin == after.origin
    for name, weight in before.weights.items():
        apart = (weight - after.weights[name]).abs().max()
        assert apart <= 0.02 * weight.abs().max(), name
    assert after.head_for(load_config(ROOT / "ground/train/configs/track.toml")).shape[1] == 269


def test_the_weights_in_half_precision_are_made_whole_first(dataset: Path, tmp_path: Path) -> None:
    out = tmp_path / "paper.onnx"
    agreement = quantise.quantise(MODELS / "paper-navigate-32bit.onnx", dataset, out, frames=FRAMES)
    assert max(agreement.differences.values()) < quantise.MOST
    assert not any(node.op_type == "Cast" for node in onnx.load(str(out)).graph.node)


def test_what_is_none_or_in_8_bits_already_and_images_of_another_size_are_one_line(
    small: tuple[Path, quantise.Agreement], dataset: Path, tmp_path: Path
) -> None:
    other = tmp_path / "other.onnx"
    other.write_bytes(b"no policy")
    for policy, why in ((other, "is no policy"), (small[0], "in 8 bits already"), (tmp_path / "none.onnx", "No such")):
        with pytest.raises(quantise.QuantiseError, match=why):
            quantise.quantise(policy, dataset, tmp_path / "out.onnx", frames=FRAMES)
    model = onnx.load(str(MODELS / "navigate-32bit.onnx"))
    for entry in model.metadata_props:
        if entry.key == CONTRACT_KEY:
            contract = json.loads(entry.value)
            entry.value = json.dumps({**contract, "image": {**contract["image"], "width": 320}})
    onnx.save(model, str(other))
    with pytest.raises(quantise.QuantiseError, match="the policy sees 320 x 96"):
        quantise.quantise(other, dataset, tmp_path / "out.onnx", frames=FRAMES)
    assert not (tmp_path / "out.onnx").exists()


def test_one_that_answers_otherwise_is_refused(dataset: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(quantise, "MOST", 1e-6)
    with pytest.raises(quantise.QuantiseError, match="answers otherwise"):
        quantise.quantise(MODELS / "navigate-32bit.onnx", dataset, tmp_path / "out.onnx", frames=FRAMES)
    assert not (tmp_path / "out.onnx").exists()


def test_the_command_writes_policy_and_card(dataset: Path, tmp_path: Path) -> None:
    out = tmp_path / "small.onnx"
    policy = str(MODELS / "navigate-32bit.onnx")
    done = goshawk("train", "quantise", policy, "--data", str(dataset), "--out", str(out), "--frames", "16")
    assert done.exit_code == 0 and "same cheapest candidate" in done.output
    card = out.with_suffix(".md").read_text()
    assert card.startswith("# Policy `small.onnx`") and "## In 8 bits" in card and "Not flown yet." in card
    assert (MODELS / "navigate.md").read_text() != card
