"""Children and whatever they started are gone when they are told to go."""

from __future__ import annotations

import os
import signal
import sys
import time
from pathlib import Path

from goshawk_ground.demo.children import Child, stop_all
from goshawk_ground.pages.ports import free_port, is_free

QUICK = ((signal.SIGINT, 1.0), (signal.SIGTERM, 1.0), (signal.SIGKILL, 2.0))


def python(code: str) -> list[str]:
    return [sys.executable, "-c", code]


def wait_for_output(child: Child, text: str) -> None:
    deadline = time.monotonic() + 10
    while text not in child.output.read_text():
        assert time.monotonic() < deadline, child.output.read_text()
        time.sleep(0.01)


def is_running(pid: int) -> bool:
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
        return False
    return Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[0] != "Z"


def test_a_polite_child_gets_sigint_and_may_tidy_up(tmp_path: Path) -> None:
    code = (
        "import time\ntry:\n  print('up', flush=True)\n  time.sleep(60)\nexcept KeyboardInterrupt:\n  print('tidied')\n"
    )
    signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it, and so would this
    child = Child("polite", python(code), tmp_path / "log")
    wait_for_output(child, "up")
    stop_all([child], QUICK)
    assert child.exit_code == 0
    assert "tidied" in child.tail()


def test_a_stubborn_child_and_its_grandchild_are_killed(tmp_path: Path) -> None:
    code = (
        "import signal, subprocess, sys, time\n"
        "signal.signal(signal.SIGINT, signal.SIG_IGN); signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "p = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        "print('grandchild', p.pid, flush=True)\n"
        "time.sleep(60)\n"
    )
    child = Child("stubborn", python(code), tmp_path / "log")
    wait_for_output(child, "grandchild")
    grandchild = int(child.tail().split()[-1])
    stop_all([child], ((signal.SIGINT, 0.3), (signal.SIGTERM, 0.3), (signal.SIGKILL, 2.0)))
    assert child.exit_code == -signal.SIGKILL
    deadline = time.monotonic() + 5
    while is_running(grandchild):
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_stopping_a_child_that_ended_by_itself_is_fine(tmp_path: Path) -> None:
    child = Child("brief", python("print('bye')"), tmp_path / "log")
    while child.exit_code is None:
        time.sleep(0.01)
    stop_all([child], QUICK)
    assert child.exit_code == 0


def test_the_tail_is_the_last_lines(tmp_path: Path) -> None:
    child = Child("wordy", python("for k in range(1000): print('line', k)"), tmp_path / "log")
    while child.exit_code is None:
        time.sleep(0.01)
    assert child.tail(3).splitlines() == ["line 997", "line 998", "line 999"]


def test_a_busy_port_is_passed_over() -> None:
    import socket

    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        assert not is_free(port)
        assert free_port(port) > port
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = taken.getsockname()[1]
        assert not is_free(port, udp=True)
        assert free_port(port, udp=True) > port
