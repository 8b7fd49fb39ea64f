# Goshawk: each target is one thing; `make help` lists them.
SHELL := /bin/bash
.DEFAULT_GOAL := help
PYTHON ?= python3.11
SEED ?= 1
VENV := .venv
UV := $(VENV)/bin/uv
PACKAGES := -e proto -e dashboards -e ground/station

.PHONY: help setup setup-train setup-rerun setup-test build demo test test-rust test-python lint bench train

help: ## this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16
	@echo
	@echo "  HEADLESS=1 make demo     fly without waiting: exit status 0 only if the flight succeeded"
	@echo "  SEED=7 make demo         another forest, another runner"

$(UV):
	@command -v cargo >/dev/null || { echo "cargo is missing: install Rust (see README)"; exit 1; }
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON) is missing: install Python 3.11, or say PYTHON=… (see README)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/pip -q install --disable-pip-version-check uv

$(VENV)/.station: ground/requirements.txt proto/pyproject.toml dashboards/pyproject.toml ground/station/pyproject.toml | $(UV)
	$(UV) pip install -q --python $(VENV)/bin/python -r ground/requirements.txt $(PACKAGES)
	@touch $@

$(VENV)/.train: ground/train/requirements.txt ground/train/pyproject.toml $(VENV)/.station
	$(UV) pip install -q --python $(VENV)/bin/python -r ground/train/requirements.txt -e ground/train
	@touch $@

$(VENV)/.rerun: ground/rerun/requirements.txt $(VENV)/.station
	$(UV) pip install -q --python $(VENV)/bin/python -r ground/rerun/requirements.txt
	@touch $@

$(VENV)/.test: tests/requirements.txt $(VENV)/.train $(VENV)/.rerun
	$(UV) pip install -q --python $(VENV)/bin/python -r tests/requirements.txt
	@command -v chromium >/dev/null || { echo "installing chromium for the browser tests"; apt-get -qq update && apt-get -qq install -y chromium >/dev/null; }
	@touch $@

setup: $(VENV)/.station build ## everything that the demo needs

setup-train: $(VENV)/.train ## everything that training needs, `goshawk dataset` too

setup-rerun: $(VENV)/.rerun ## what `goshawk export --format rerun` needs (700 MB)

setup-test: $(VENV)/.test ## everything that the tests need

build:
	cargo build --release --locked --bins

demo: setup ## simulator, vehicle and ground station: a chase through a forest (SEED=n, HEADLESS=1)
	$(VENV)/bin/goshawk demo --seed $(SEED) $(if $(HEADLESS),--headless)

lint: setup-test ## formatters and linters
	cargo fmt --all --check
	cargo clippy --release --locked --workspace --all-targets -- -D warnings
	$(VENV)/bin/ruff check --config ground/ruff.toml ground dashboards proto tests
	$(VENV)/bin/ruff format --config ground/ruff.toml --check ground dashboards proto tests
	$(VENV)/bin/pyright -p ground/pyrightconfig.json

test-rust: setup-test
	cargo test --release --locked --workspace

test-python: setup-test build
	$(VENV)/bin/pytest -q --import-mode=importlib ground dashboards tests

test: lint test-rust test-python ## exactly what CI runs

bench: setup setup-train build ## speed, each figure against its yardstick
	cargo bench --locked --workspace
	$(VENV)/bin/python -m goshawk_train.bench
	$(VENV)/bin/python ground/station/benches/telemetry.py
	$(VENV)/bin/python ground/station/benches/dashboard.py

train: $(VENV)/.train build ## data set, training and export of both policies (two and a half hours; goes on where it stopped)
	target/release/goshawk-sim dataset --out data/train --scenes 480 --frames 128 --seed 1
	target/release/goshawk-sim dataset --out data/val --scenes 12 --frames 128 --seed 900001
	$(VENV)/bin/goshawk dataset check data/train --against data/val
	$(VENV)/bin/python -m goshawk_train train --config ground/train/configs/track.toml --data data/train --validation data/val --out runs/track --resume
	$(VENV)/bin/python -m goshawk_train export --run runs/track --data data/val --out air/models/track.onnx
	$(VENV)/bin/python -m goshawk_train train --config ground/train/configs/navigate.toml --data data/train --validation data/val --out runs/navigate --from runs/track --resume
	$(VENV)/bin/python -m goshawk_train export --run runs/navigate --data data/val --out air/models/navigate.onnx
