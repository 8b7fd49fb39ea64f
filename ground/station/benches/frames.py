"""How many frames a second a browser draws of a flight, on a machine's processor alone; called by `dashboard.py`.

The flight is the browser tests' stand-in vehicle, so nothing is simulated beside it. It is drawn twice. *As the browser
chooses* is Chromium left to itself on a machine without a graphics card: SwiftShader draws the scene, and the processor
paints the page around it. A laptop whose processor is as fast shows no less, whatever its graphics card adds; none was
measured. *All by SwiftShader* forces the page, too, through an imitated graphics card; the yardstick, an
empty scene of viser's in the same window, is drawn so.

Where other programs run, frames a second say little, but what one frame takes does not change: it is printed too.
"""

from __future__ import annotations

import contextlib
import os
import re
import shutil
import subprocess
import sys
import time
from collections.abc import Generator
from dataclasses import dataclass

import viser
from common import ROOT, core_seconds_of_threads, free_port, record, verdict
from playwright.sync_api import Page, sync_playwright

WIDTH, HEIGHT = 1280, 720
TARGET_HZ = 10.0
"""All by SwiftShader."""
TARGET_CHOSEN_HZ = 30.0
"""As the browser chooses: what is wanted of a laptop's integrated graphics card, asked of a machine that has none."""
SETTLE_S = 15.0
"""Until shaders are compiled, and viser has found how many pixels it can draw."""
CHOSEN = ("--no-sandbox", "--enable-unsafe-swiftshader")
FORCED = (*CHOSEN, "--use-angle=swiftshader", "--ignore-gpu-blocklist")
COUNT = """window.framesDrawn = 0;
const clear = WebGL2RenderingContext.prototype.clear;
WebGL2RenderingContext.prototype.clear = function (mask) {
  if (this.getParameter(this.FRAMEBUFFER_BINDING) === null) window.framesDrawn++;
  return clear.call(this, mask);
};
window.asked = { draws: 0, triangles: 0 };
for (const [name, count] of Object.entries({
  drawArrays: (mode, first, n) => n, drawElements: (mode, n) => n,
  drawArraysInstanced: (mode, first, n, copies) => n * copies,
  drawElementsInstanced: (mode, n, type, offset, copies) => n * copies,
})) {
  const draw = WebGL2RenderingContext.prototype[name];
  WebGL2RenderingContext.prototype[name] = function (...given) {
    window.asked.draws++;
    if (given[0] === this.TRIANGLES) window.asked.triangles += count(...given) / 3;
    return draw.apply(this, given);
  };
}"""


@dataclass(frozen=True, kw_only=True)
class Drawn:
    """What was seen of one page."""

    hz: float
    frame_ms: float
    """On a core, of the browser's processes, for one frame and what came with it."""
    draws: float
    triangles: float
    """What is asked of a graphics card, if there is one, for one frame."""


def measure(seconds: float) -> None:
    """Draws both scenes, then prints and records."""
    with empty_scene() as url:
        floor = watch(url, seconds, FORCED)
    with flight() as url:
        seen = watch(url, seconds, FORCED)
    with flight() as url:
        chosen = watch(url, seconds, CHOSEN)
    print(f"frames drawn without a graphics card, {WIDTH} x {HEIGHT}, {seconds:.0f} s each")
    for what, drawn, target_hz in (
        ("empty scene, all by SwiftShader", floor, None),
        ("flight, all by SwiftShader", seen, TARGET_HZ),
        ("flight, as the browser chooses", chosen, TARGET_CHOSEN_HZ),
    ):
        judged = "" if target_hz is None else f"   target {target_hz:g}: {verdict(drawn.hz >= target_hz)}"
        print(f"  {what:<32}{drawn.hz:6.1f} frames/s, {drawn.frame_ms:4.0f} ms of a core each{judged}")
    print(f"  a frame of the flight asks for {seen.draws:.0f} draws, {seen.triangles:.0f} triangles")
    record("dashboard_frames_per_s", round(seen.hz, 2))
    record("dashboard_frames_per_s_chosen", round(chosen.hz, 2))
    record("dashboard_frames_per_s_empty_scene", round(floor.hz, 2))
    record("dashboard_frame_core_ms", round(seen.frame_ms, 1))
    record("dashboard_frame_draws", round(seen.draws))
    record("dashboard_frame_triangles", round(seen.triangles))


def watch(url: str, seconds: float, flags: tuple[str, ...]) -> Drawn:
    """Opens a page in a browser of its own and counts."""
    chromium = shutil.which("chromium")
    if chromium is None:
        raise SystemExit("chromium is missing: `make setup-test` installs it")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium, args=flags)
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT})
        page.add_init_script(COUNT)
        page.set_default_timeout(120_000)
        page.goto(url)
        page.wait_for_function("window.framesDrawn > 3")
        time.sleep(SETTLE_S)
        pids = browser_pids()
        began_s, before, used_s = time.monotonic(), counted(page), core_seconds(pids)
        time.sleep(seconds)
        frames, draws, triangles = (now - was for now, was in zip(counted(page), before, strict=True))
        lasted_s, used_s = time.monotonic() - began_s, core_seconds(pids) - used_s
        browser.close()
    if not frames:
        raise SystemExit(f"the page drew no frame in {lasted_s:.0f} s: is this machine busy?")
    return Drawn(
        hz=frames / lasted_s, frame_ms=1e3 * used_s / frames, draws=draws / frames, triangles=triangles / frames
    )


def counted(page: Page) -> tuple[int, int, int]:
    """Frames, draws and triangles of the scene since the page began."""
    frames, draws, triangles = page.evaluate("[window.framesDrawn, window.asked.draws, window.asked.triangles]")
    return frames, draws, triangles


def core_seconds(pids: list[int]) -> float:
    """Of all these processes."""
    return sum(sum(core_seconds_of_threads(pid).values()) for pid in pids)


def browser_pids() -> list[int]:
    """The browser's processes that draw: they descend from this one."""
    found = subprocess.run(["ps", "-eo", "pid=,ppid=,args="], capture_output=True, text=True, check=True).stdout
    parents, drawing = dict[int, int](), list[int]()
    for pid, parent, command in (line.split(None, 2) for line in found.splitlines()):
        parents[int(pid)] = int(parent)
        if re.search(r"--type=(gpu-process|renderer)\b", command):
            drawing.append(int(pid))
    return [pid for pid in drawing if descends(pid, parents)]


def descends(pid: int, parents: dict[int, int]) -> bool:
    """Whether a process comes of this one."""
    while pid in parents and pid != os.getpid():
        pid = parents[pid]
    return pid == os.getpid()


@contextlib.contextmanager
def empty_scene() -> Generator[str]:
    """A scene of viser's with nothing in it, which is told to draw as often as the dashboard is."""
    port = str(free_port())
    server = subprocess.Popen([sys.executable, __file__, port], stdout=subprocess.PIPE, text=True)
    try:
        if server.stdout is None or not any(line == "serving\n" for line in server.stdout):
            raise SystemExit("the empty scene did not start")
        yield f"http://127.0.0.1:{port}/"
    finally:
        end(server)


def serve_empty(port: int) -> None:
    """Until it is ended."""
    server = viser.ViserServer(host="127.0.0.1", port=port, verbose=False)
    print("serving", flush=True)
    while True:
        server.scene.world_axes.position = (0.0, 0.0, 0.001 * (time.time() % 1.0))
        time.sleep(1.0 / 15.0)


@contextlib.contextmanager
def flight() -> Generator[str]:
    """The dashboard of a stand-in vehicle that flies slowly through its forest, so that it does not leave it."""
    endpoint = f"tcp/127.0.0.1:{free_port()}"
    fake = str(ROOT / "tests/browser/fake_vehicle.py")
    vehicle = subprocess.Popen(
        [sys.executable, fake, "--listen", endpoint, "--speed", "0.3"], stdout=subprocess.PIPE, text=True
    )
    command = [sys.executable, "-c", "from goshawk_ground.cli import main; main()"]
    ground = None
    try:
        if vehicle.stdout is None or vehicle.stdout.readline() != "listening\n":
            raise SystemExit("the vehicle did not start")
        named = ["--vehicle", f"goshawk@{endpoint}"]
        ground = subprocess.Popen(
            [*command, "ground", "--port", str(free_port()), *named], stdout=subprocess.PIPE, text=True
        )
        first = "" if ground.stdout is None else ground.stdout.readline()
        if not first.startswith("dashboard:"):
            raise SystemExit("the ground station did not start")
        subprocess.run([*command, "start", "--connect", endpoint], check=True, stdout=subprocess.DEVNULL)
        yield first.split()[1]
    finally:
        for process in filter(None, (ground, vehicle)):
            end(process)


def end(process: subprocess.Popen[str]) -> None:
    """Politely."""
    process.terminate()
    process.wait(timeout=20)


if __name__ == "__main__":
    serve_empty(int(sys.argv[1]))
