"""The model card: what lies beside a shipped policy as Markdown. Needs no torch."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path
from typing import Any

from goshawk_train.config import Config

CONTRACT_KEY = "goshawk_contract"
"""Of the contract in the ONNX file's metadata."""
FILE_MARKS = ("<!-- file: begin -->", "<!-- file: end -->")
"""What `goshawk-sim golden` writes in the card stands between these."""
FLIGHT_MARKS = ("<!-- flights: begin -->", "<!-- flights: end -->")
"""What the policy flew in campaigns stands between these, in the card and in the results."""


def model_card(
    config: Config,
    training: dict[str, Any],
    metrics: dict[str, float],
    *,
    configuration: str,
    frames: int,
    parameters: int,
    file: Path,
) -> str:
    """The Markdown that lies beside a shipped policy; `training` is of its contract, `configuration` the name of
    the run's, `frames` how many held-out ones there are."""
    figures = "\n".join(f"| {name} | {value:.4g} |" for name, value in metrics.items())
    return f"""# Policy `{file.name}`

Task: {config.task}. ResNet-18 with stages of {", ".join(map(str, config.network.channels))} channels,
{parameters:,} parameters, {file.stat().st_size / 1e6:.1f} MB. Input: RGB-D of
{config.camera.width} x {config.camera.height} and {sum(config.state_sizes.values())} state values
({", ".join(config.network.state)}; camera frame). Output: {config.lattice.anchors} anchors of
{len(config.channel_names)} channels. The contract is in the file's metadata, key `{CONTRACT_KEY}`.

## Training
{training["samples"]:,} samples in {training["hours"]:.2f} h on {training["hardware"]}; weight average
{config.training.ema:g}, seed {training["seed"]}, commit `{training["commit"]}`, configuration
{configuration}. Data set: {training["data"]}.

## Held-out scenes
{min(config.training.validate_frames, frames)} frames of scenes never trained on, states drawn like the training's.
Distances in m. `collide_*`: share of trajectories that come nearer than 0.16 m to an obstacle within T, many of them
from states that no trajectory could save (drawn at random: full speed, half a metre before a trunk).

| metric | value |
|---|---|
{figures}

## Flights
`goshawk campaign flights` writes here what the policy flew, worst cells included.

{FLIGHT_MARKS[0]}
Not flown yet.
{FLIGHT_MARKS[1]}

## Limits
Trained on synthetic forests with a synthetic person only, at alpha = 1; flight scales by alpha. It sees one frame:
what is hidden behind a trunk is unknown to it. Targets were 1.2 to 18 m away.

## File
`goshawk-sim golden --policy {file.name}` adds the golden images, without which no vehicle is ready.

{FILE_MARKS[0]}
{_hash(file)}
{FILE_MARKS[1]}
"""


def quantised_card(card: str, before: Path, after: Path, how: str) -> str:
    """The card of what was made of `before`, whose `card` it was; `how` says how it was made, and what it answers."""
    origin = Path(os.path.relpath(before.with_suffix(".md"), after.parent)).as_posix()
    how = f"Made of [`{before.name}`]({origin}), whose training and held-out scenes these are. {how}"
    for marks, text in ((FLIGHT_MARKS, "Not flown yet."), (FILE_MARKS, _hash(after))):
        head, _, rest = card.partition(marks[0])
        card = f"{head}{marks[0]}\n{text}\n{marks[1]}{rest.partition(marks[1])[2]}"
    was, now = (f"{file.stat().st_size / 1e6:.1f} MB" for file in (before, after))
    card = card.replace(f"`{before.name}`", f"`{after.name}`").replace(was, now, 1)
    card = card.replace(f"--policy {before.name}", f"--policy {after.name}")
    return card.replace("## Flights\n", f"## In 8 bits\n{how}\n\n## Flights\n", 1)


def _hash(file: Path) -> str:
    return f"| file | SHA-256 |\n|---|---|\n| model | `{hashlib.sha256(file.read_bytes()).hexdigest()}` |"
