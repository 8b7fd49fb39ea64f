"""`goshawk keys pair --ssh` against a real sshd on the loopback, as the user who runs the test."""

from __future__ import annotations

import getpass
import os
import shutil
import socket
import stat
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from goshawk_ground.keys.chosen import demo_identities
from goshawk_ground.keys.identity import read_identity
from goshawk_ground.keys.names import BadNameError
from goshawk_ground.keys.pairing import SCRIPT, parse_place
from goshawk_ground.keys.parcel import pack

SSHD = shutil.which("sshd") or shutil.which("sshd", path="/usr/sbin")


@pytest.fixture
def loopback(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """USER@HOST that the `ssh` on PATH reaches: the system's own, with a configuration and a key of the test's."""
    assert SSHD and shutil.which("ssh"), "install openssh-server and openssh-client"
    ssh_dir = tmp_path / "ssh"
    ssh_dir.mkdir(mode=0o700)
    for name in ("host", "user"):
        subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", ssh_dir / name], check=True)
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    (ssh_dir / "sshd_config").write_text(
        f"ListenAddress 127.0.0.1:{port}\nHostKey {ssh_dir}/host\nAuthorizedKeysFile {ssh_dir}/user.pub\n"
        "PidFile none\nStrictModes no\nPasswordAuthentication no\nPermitRootLogin prohibit-password\n"
    )
    (ssh_dir / "config").write_text(
        f"Host *\n HostName 127.0.0.1\n Port {port}\n IdentityFile {ssh_dir}/user\n IdentitiesOnly yes\n"
        " BatchMode yes\n"
        f" StrictHostKeyChecking no\n UserKnownHostsFile {ssh_dir}/known\n LogLevel ERROR\n"
    )
    wrapper = tmp_path / "bin/ssh"
    wrapper.parent.mkdir()
    wrapper.write_text(f'#!/bin/sh\nexec {shutil.which("ssh")} -F {ssh_dir}/config "$@"\n')
    wrapper.chmod(0o755)
    monkeypatch.setenv("PATH", f"{wrapper.parent}:{os.environ['PATH']}")
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    Path("/run/sshd").mkdir(exist_ok=True)  # sshd wants its empty folder
    server = subprocess.Popen([SSHD, "-D", "-e", "-f", ssh_dir / "sshd_config"], stderr=subprocess.DEVNULL)
    for _ in range(600):
        with socket.socket() as probe:
            if probe.connect_ex(("127.0.0.1", port)) == 0:
                break
        time.sleep(0.05)
    yield f"{getpass.getuser()}@vehicle"
    server.terminate()
    server.wait()


def pair(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [
        sys.executable,
        "-c",
        "from goshawk_ground.cli import main; main()",
        "keys",
        "pair",
        *map(str, arguments),
    ]
    return subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)


def test_one_command_pairs_a_laptop_with_a_vehicle(loopback: str, tmp_path: Path) -> None:
    there = tmp_path / "a vehicle's/identity"
    done = pair("hawk", "--ssh", f"{loopback}:{there}")
    assert done.returncode == 0, done.stderr
    assert f'identity = "{there}"' in done.stdout
    assert "goshawk status --vehicle hawk --connect tls/vehicle:7447" in done.stdout
    made = read_identity(there)
    assert str(made.who) == "vehicle.hawk"
    assert len(made.access.operators) == 1
    assert stat.S_IMODE(there.stat().st_mode) == 0o700
    assert stat.S_IMODE((there / "key.pem").stat().st_mode) == 0o600
    before = (there / "key.pem").read_bytes()
    assert pair("hawk", "--ssh", f"{loopback}:{there}").returncode == 0
    assert (there / "key.pem").read_bytes() == before
    assert [path.name for path in there.parent.iterdir()] == ["identity"]


def test_a_copy_that_is_cut_leaves_the_old_one(tmp_path: Path) -> None:
    vehicle, _ = demo_identities(tmp_path / "new")
    there = tmp_path / "there/identity"
    old, _ = demo_identities(tmp_path / "old")
    shutil.copytree(old, there)
    before = {path.name: path.read_bytes() for path in there.iterdir()}
    whole = pack(read_identity(vehicle))
    for length in (0, 700, 2048, whole.index(b"access.toml")):
        command = ["sh", "-c", SCRIPT, "sh", str(there)]
        done = subprocess.run(command, input=whole[:length], capture_output=True, check=False)
        assert done.returncode != 0
        assert {path.name: path.read_bytes() for path in there.iterdir()} == before
        assert [path.name for path in there.parent.iterdir()] == ["identity"]


def test_what_is_no_identity_is_left_alone(loopback: str, tmp_path: Path) -> None:
    there = tmp_path / "etc"
    there.mkdir()
    (there / "passwd").write_text("root")
    done = pair("hawk", "--ssh", f"{loopback}:{there}")
    assert done.returncode == 1
    assert done.stderr.strip() == (
        f"goshawk: {loopback} was not paired: {there} holds passwd: name a folder for the identity alone"
    )
    assert [path.name for path in there.iterdir()] == ["passwd"]


def test_a_host_that_refuses_is_one_line(loopback: str, tmp_path: Path) -> None:
    (tmp_path / "ssh/user").unlink()
    done = pair("hawk", "--ssh", loopback)
    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1
    assert "was not paired: " in done.stderr and "Permission denied" in done.stderr


@pytest.mark.parametrize("text", ["", "-oProxyCommand=x", "pi@-x", "pi@host x", "pi@"])
def test_what_is_no_place_is_refused(text: str) -> None:
    with pytest.raises(BadNameError):
        parse_place(text)


def test_a_place_may_have_a_folder_and_an_address_of_six() -> None:
    assert parse_place("pi@hawk.local").login == "pi@hawk.local"
    place = parse_place("pi@[fe80::1]:~/identity/")
    assert (place.login, place.host, place.folder) == ("pi@fe80::1", "[fe80::1]", "identity")


def test_a_host_that_says_nothing_was_not_paired(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    silent = tmp_path / "silent"
    silent.mkdir()
    (silent / "ssh").write_text("#!/bin/sh\ncat >/dev/null\n")
    (silent / "ssh").chmod(0o755)
    monkeypatch.setenv("PATH", f"{silent}:{os.environ['PATH']}")
    done = pair("hawk", "--ssh", "pi@host")
    assert done.returncode == 1 and len(done.stderr.strip().splitlines()) == 1
    assert "pi@host was not paired" in done.stderr
