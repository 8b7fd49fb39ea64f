# Goshawk: each target is one thing; `make help` lists them.
SHELL := /bin/bash
.DEFAULT_GOAL := help
PYTHON ?= python3.11
SEED ?= 1
N ?= 10000
HOST := $(shell dpkg --print-architecture 2>/dev/null)
ARCH ?= $(HOST)
# Built for the other processor: only a 64-bit ARM is built for elsewhere.
CROSS := $(if $(filter-out $(HOST),$(ARCH)),aarch64-unknown-linux-gnu)
export CARGO_TARGET_AARCH64_UNKNOWN_LINUX_GNU_LINKER := $(if $(CROSS),aarch64-linux-gnu-gcc,cc)
# What only x86-64 has packages of: OpenVINO, librealsense, and the ray caster of the benchmarks.
X86 := $(filter amd64,$(HOST))
BUILT := target/$(if $(CROSS),$(CROSS)/)release
VENV := .venv
UV := $(VENV)/bin/uv
# Only what the requirements name by its hash is installed; our own packages bring nothing with them.
INSTALL := $(UV) pip install -q --python $(VENV)/bin/python --require-hashes --override ground/train/overrides.txt
INSTALL_OWN := $(UV) pip install -q --python $(VENV)/bin/python --no-deps --no-build-isolation
PIN := $(UV) pip compile -q --no-header --no-annotate --generate-hashes --override ground/train/overrides.txt
# PyTorch's own build for the processor alone; with CUDA=1 the registry's, which brings CUDA and is known by its hash.
TORCH_CUDA = $(INSTALL) -r ground/train/torch/requirements.txt
TORCH_CPU = $(UV) pip install -q --python $(VENV)/bin/python --no-deps --torch-backend cpu \
  $$(grep -o '^torch==[^ ]*' ground/train/torch/requirements.txt)
TORCH = $(if $(CUDA),$(TORCH_CUDA),$(TORCH_CPU) || \
  { echo "PyTorch's own index did not give a torch without CUDA: installing the registry's, 4 GB with CUDA"; $(TORCH_CUDA); })

.PHONY: help setup setup-camera setup-openvino setup-train setup-campaign setup-rerun setup-test build build-tests demo sitl test test-rust test-python test-timed test-untimed test-install lint docs pins deny fuzz bench chaos train wheel deb image release

help: ## this list
	@grep -E '^[a-z-]+:.*##' $(MAKEFILE_LIST) | sed -E 's/:.*## /\t/' | expand -t 16
	@echo
	@echo "  HEADLESS=1 make demo     fly without waiting: exit status 0 only if the flight succeeded"
	@echo "  SEED=7 make demo         another forest, another target"
	@echo "  TASK=navigate make demo  to a goal, with nobody to chase"
	@echo "  ARCH=arm64 make deb      for the other processor (amd64, arm64)"
	@echo "  CUDA=1 make setup-train  to train on an NVIDIA card: torch with CUDA, 4 GB"

$(UV):
	@command -v cargo >/dev/null || { echo "cargo is missing: install Rust (see README)"; exit 1; }
	@command -v $(PYTHON) >/dev/null || { echo "$(PYTHON) is missing: install Python 3.11, or say PYTHON=… (see README)"; exit 1; }
	$(PYTHON) -m venv $(VENV)
	$(VENV)/bin/pip -q install --disable-pip-version-check --require-hashes -r ground/bootstrap/requirements.txt

$(VENV)/.station: ground/requirements.txt pyproject.toml | $(UV)
	$(INSTALL) -r ground/requirements.txt
	$(INSTALL_OWN) -e .
	@touch $@

$(VENV)/.train: ground/train/requirements.txt ground/train/torch/requirements.txt ground/train/pyproject.toml $(VENV)/.station
	$(INSTALL) -r ground/train/requirements.txt
	$(TORCH)
	$(INSTALL_OWN) -e ground/train
	@touch $@

$(VENV)/.campaign: ground/campaign/requirements.txt ground/train/pyproject.toml $(VENV)/.station
	$(INSTALL) -r ground/campaign/requirements.txt
	$(INSTALL_OWN) -e ground/train
	@touch $@

$(VENV)/.rerun: ground/rerun/requirements.txt $(VENV)/.station
	$(INSTALL) -r ground/rerun/requirements.txt
	@touch $@

$(VENV)/.camera: air/sensors/requirements.txt air/sensors/pyproject.toml $(VENV)/.station
	$(INSTALL) -r air/sensors/requirements.txt
	$(INSTALL_OWN) -e air/sensors
	@touch $@

$(VENV)/.bench: ground/sim/benches/requirements.txt $(VENV)/.station
	$(INSTALL) -r ground/sim/benches/requirements.txt
	@touch $@

$(VENV)/.openvino: air/policy/openvino/requirements.txt | $(UV)
	$(INSTALL) --no-deps --target $(VENV)/openvino -r $<
	@touch $@

# The tests run with exactly what is pinned.
$(VENV)/.test: CUDA = 1
$(VENV)/.test: tests/requirements.txt $(VENV)/.train $(VENV)/.campaign $(VENV)/.rerun $(VENV)/.camera $(if $(X86),$(VENV)/.openvino)
	$(INSTALL) -r tests/requirements.txt
	@command -v chromium >/dev/null && test -x /usr/sbin/sshd && command -v ip >/dev/null || { \
	  echo "installing chromium, sshd and ip for the tests"; \
	  apt-get -qq update && apt-get -qq install -y chromium openssh-server iproute2 >/dev/null; }
	@touch $@

setup: $(VENV)/.station build ## everything that the demo needs

setup-camera: $(VENV)/.camera ## everything that `goshawk-camera` needs, on the vehicle (on arm64 without librealsense: docs/how-to/camera.md)

setup-openvino: $(VENV)/.openvino ## ONNX Runtime for Intel processors and their graphics, in .venv/openvino (x86-64)

setup-train: $(VENV)/.train ## everything that `goshawk train`, `dataset` and `campaign` need

setup-campaign: $(VENV)/.campaign ## what `goshawk campaign run`, `query`, `worst` and `compare A B` need: Ray, DuckDB

setup-rerun: $(VENV)/.rerun ## what `goshawk export --format rerun` needs (700 MB)

setup-test: $(VENV)/.test ## everything that the tests need

build:
	cargo build --release --locked --bins $(if $(CROSS),--target $(CROSS))

wheel: | $(UV) ## the ground half as one Python package, in dist: for pipx or uvx
	@rm -rf build
	$(UV) build -q --wheel --no-build-isolation --python $(VENV)/bin/python -o dist .
	@rm -rf build # what an earlier one left would be packed too
	@ls dist/*.whl

deb: build | $(UV) ## onboard process, ROS 2 bridge and simulator as Debian packages, in dist (ARCH=amd64 or arm64)
	air/deb/build.sh $(ARCH) $(BUILT) dist

image: deb ## the onboard half as a container image, from its package (needs buildah)
	buildah build --arch $(ARCH) --build-arg DEB=$$(cd dist && ls goshawk-air_*_$(ARCH).deb) -t goshawk-air -f air/deb/Containerfile dist

test-install: wheel deb ## wheel and packages in a Debian that has nothing else, where they fly the demo (needs root, debootstrap)
	tests/install/clean_root.sh dist

release: ## the files in dist as the release TAG=v…, which must be the version that they have (CI calls it)
	@test "$(TAG)" = "v$$(sed -n 's/^version = "\([^"]*\)".*/\1/p' pyproject.toml)" || { echo "TAG=$(TAG) is not the version in pyproject.toml"; exit 1; }
	gh release create $(TAG) --verify-tag --generate-notes dist/*.whl dist/*.deb

demo: setup ## simulator, vehicle and ground station: a chase through a forest (SEED=n, TASK=navigate, HEADLESS=1)
	$(VENV)/bin/goshawk demo --seed $(SEED) $(if $(TASK),--task $(TASK)) $(if $(HEADLESS),--headless)

sitl: setup ## the demo flown by firmware that you have built: PX4=DIR or ARDUPILOT=DIR (docs/how-to/firmware.md)
	$(VENV)/bin/goshawk demo --seed $(SEED) $(if $(HEADLESS),--headless) $(if $(PX4),--px4 "$(PX4)") $(if $(ARDUPILOT),--ardupilot "$(ARDUPILOT)")

lint: setup-test ## formatters and linters
	cargo fmt --all --check
	cargo clippy --release --locked --workspace --all-targets -- -D warnings
	$(VENV)/bin/ruff check
	$(VENV)/bin/ruff format --check
	$(VENV)/bin/pyright

docs: setup-test build ## docs/reference made anew from the programs, the wire and the log's channels; docs/pictures from a demo
	$(VENV)/bin/python docs/generate.py
	$(VENV)/bin/python docs/pictures.py

test-rust: setup-test
	cargo test --release --locked --workspace

fuzz: ## damaged input for MINUTES=60 each, all targets or TARGET=mcap (tests/fuzz); what breaks is kept in its corpus
	BOLERO_RANDOM_TEST_TIME_MS=$$(($(or $(MINUTES),60) * 60000)) cargo test --release --locked -p goshawk-fuzz --test targets -- $(if $(TARGET),--exact $(TARGET))

# With the examples, and so with the features that `cargo test` gives the crates: it has built them all.
build-tests:
	cargo build --release --locked --workspace --bins --examples

# What meets real processes and browsers, as time passes, goes first. All other tests have what processor time that leaves.
# Browsers come last: their driver keeps an event loop in the process, where no other can be run then.
TIMED := air/sensors ground/station tests/e2e tests/mavlink tests/ros2 tests/examples tests/browser

test-python: setup-test build-tests
	@$(MAKE) --no-print-directory -j2 test-timed test-untimed

test-timed:
	$(VENV)/bin/pytest -q $(TIMED)

test-untimed:
	@nice -n 5 $(VENV)/bin/pytest -q $(TIMED:%=--ignore=%) >target/untimed.log 2>&1; status=$$?; \
	  if [ $$status = 0 ]; then tail -n 1 target/untimed.log; else cat target/untimed.log; fi; exit $$status

pins: | $(UV) ## Python packages pinned anew, by their hashes (UPGRADE=1: to current releases)
	$(PIN) $(if $(UPGRADE),--upgrade) tests/requirements.in -o tests/requirements.txt
	for f in ground/bootstrap ground ground/rerun ground/campaign ground/train ground/train/torch ground/sim/benches; do \
	  $(PIN) $(if $(UPGRADE),--upgrade) $$f/requirements.in -c tests/requirements.txt -o $$f/requirements.txt || exit 1; done
	$(PIN) $(if $(UPGRADE),--upgrade) --no-strip-markers air/sensors/requirements.in -o air/sensors/requirements.txt
	$(PIN) $(if $(UPGRADE),--upgrade) --no-deps air/policy/openvino/requirements.in -o air/policy/openvino/requirements.txt

deny: ## licences, sources, duplicate and vulnerable crates, by cargo-deny (which it installs)
	@command -v cargo-deny >/dev/null || cargo install --locked cargo-deny
	cargo deny --locked check licenses bans sources
	@cargo deny --locked fetch db >/dev/null 2>&1 || { echo "advisories NOT checked: their data base cannot be had from here; run make deny where it can"; exit 1; }
	cargo deny --locked check --disable-fetch advisories

test: lint test-rust test-python ## exactly what CI runs

bench: setup setup-train setup-campaign setup-camera $(if $(X86),$(VENV)/.openvino $(VENV)/.bench) build ## speed, each figure against its yardstick
	@missing=; try() { echo "$$*"; "$$@" || missing="$$missing\n  $$*"; }; \
	try cargo bench --locked --workspace --no-fail-fast; \
	$(if $(X86),try $(VENV)/bin/python ground/sim/benches/embree.py,echo "Embree is not timed: there is no package of it for this processor"); \
	try $(VENV)/bin/goshawk train bench; \
	try $(VENV)/bin/python ground/train/benches/network.py; \
	try $(VENV)/bin/python ground/station/benches/telemetry.py; \
	try $(VENV)/bin/python ground/station/benches/dashboard.py; \
	try $(VENV)/bin/python ground/station/benches/dashboard.py --frames --seconds 30; \
	try $(VENV)/bin/python ground/station/benches/gate.py; \
	try $(VENV)/bin/python dashboards/benches/review.py; \
	try $(VENV)/bin/python ground/train/benches/campaign_scaling.py; \
	$(if $(X86),try env PYTHONPATH=air/sensors/tests:ground/station/benches $(VENV)/bin/python air/sensors/benches/camera.py,echo "goshawk-camera is not timed: there is no package of librealsense for this processor"); \
	test -z "$$missing" || { printf "these have no figure, run them again:$$missing\n"; exit 1; }

chaos: setup ## flights with seeded schedules of faults, every step judged (SEED=n, N=how many)
	target/release/goshawk-sim chaos --seed $(SEED) --schedules $(N)

train: $(VENV)/.train build ## data set, training and export of both policies (some hours, far less with a GPU; goes on where it stopped)
	target/release/goshawk-sim dataset --out data/train --scenes 480 --frames 128 --seed 900000
	target/release/goshawk-sim dataset --out data/val --scenes 12 --frames 128 --seed 900001
	$(VENV)/bin/goshawk dataset check data/train --against data/val
	$(VENV)/bin/goshawk train run --config ground/train/configs/track.toml --data data/train --validation data/val --out runs/track --resume
	$(VENV)/bin/goshawk train export --run runs/track --data data/val --out air/models/track-32bit.onnx
	$(VENV)/bin/goshawk train quantise air/models/track-32bit.onnx --data data/val --out air/models/track.onnx
	$(VENV)/bin/goshawk train run --config ground/train/configs/navigate-first.toml --data data/train --validation data/val --out runs/navigate-first --from runs/track --resume
	$(VENV)/bin/goshawk train run --config ground/train/configs/navigate.toml --data data/train --validation data/val --out runs/navigate --from runs/navigate-first --resume
	$(VENV)/bin/goshawk train export --run runs/navigate --data data/val --out air/models/navigate-32bit.onnx
	$(VENV)/bin/goshawk train quantise air/models/navigate-32bit.onnx --data data/val --out air/models/navigate.onnx
