"""The checked-in golden vectors are what the generator writes."""

from __future__ import annotations

import importlib.util
import json
import math
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

import pytest

HERE = Path(__file__).parent


def load_generators() -> dict[str, object]:
    spec = importlib.util.spec_from_file_location("goshawk_vectors_generate", HERE / "generate.py")
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return dict(module.GENERATORS)


GENERATORS = load_generators()


def assert_same(path: str, stored: Any, fresh: Any) -> None:
    """Equal but for the last bits, which differ between numerical libraries."""
    if isinstance(fresh, dict):
        assert isinstance(stored, dict) and stored.keys() == fresh.keys(), path
        for key, value in cast("dict[str, Any]", fresh).items():
            assert_same(f"{path}.{key}", cast("dict[str, Any]", stored)[key], value)
    elif isinstance(fresh, list | tuple):
        values = cast("Sequence[Any]", fresh)
        assert isinstance(stored, list), path
        for index, (old, value) in enumerate(zip(cast("list[Any]", stored), values, strict=True)):
            assert_same(f"{path}[{index}]", old, value)
    elif isinstance(fresh, float):
        assert isinstance(stored, float | int), path
        assert math.isclose(stored, fresh, rel_tol=1e-11, abs_tol=1e-11), f"{path}: {stored} != {fresh}"
    else:
        assert stored == fresh, path


@pytest.mark.parametrize("name", sorted(GENERATORS))
def test_checked_in_vectors_are_what_the_generator_writes(name: str) -> None:
    generator = GENERATORS[name]
    assert callable(generator)
    assert_same(name, json.loads((HERE / f"{name}.json").read_text()), generator())
