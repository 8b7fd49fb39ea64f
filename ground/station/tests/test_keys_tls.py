"""Identities on a wire: Python's TLS, and Zenoh's, between a vehicle and those who dial it."""

from __future__ import annotations

import socket
import ssl
import subprocess
import sys
import tempfile
import threading
from datetime import UTC, datetime
from pathlib import Path

import pytest
import zenoh
from goshawk_ground.keys.authority import BEGINS, in_days
from goshawk_ground.keys.identity import read_identity
from goshawk_ground.keys.keyring import Keyring
from goshawk_ground.keys.names import Holder, Role
from goshawk_ground.keys.zenoh_config import zenoh_config
from goshawk_ground.link import LinkError
from goshawk_ground.link.dial import Way

PEOPLE = {"vehicle": "hawk", "operator": "alice", "observer": "bob"}


def make_ring(folder: Path) -> Path:
    ring = Keyring(folder=folder)
    ring.init()
    for role, name in PEOPLE.items():
        ring.make(Holder(role=Role(role), name=name), in_days(30))
    ring.make(Holder(role=Role.OPERATOR, name="late"), datetime(2024, 1, 1, tzinfo=UTC))
    return folder


@pytest.fixture(scope="module")
def ring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_ring(tmp_path_factory.mktemp("ring") / "keys")


@pytest.fixture(scope="module")
def foreign(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_ring(tmp_path_factory.mktemp("foreign") / "keys")


def context(folder: Path, side: int) -> ssl.SSLContext:
    made = ssl.SSLContext(side)
    made.check_hostname = False
    made.verify_mode = ssl.CERT_REQUIRED
    made.load_verify_locations(folder / "ca.pem")
    made.load_cert_chain(folder / "cert.pem", folder / "key.pem")
    return made


def handshake(server: Path, client: Path) -> str:
    """Sends a word both ways; returns "" or what either side found wrong."""
    wrong: list[str] = []
    near, far = socket.socketpair()
    near.settimeout(20)
    far.settimeout(20)

    def serve() -> None:
        try:
            with context(server, ssl.PROTOCOL_TLS_SERVER).wrap_socket(far, server_side=True) as wire:
                wire.sendall(wire.recv(4))
        except (ssl.SSLError, OSError) as error:
            wrong.append(str(error))
        finally:
            far.close()

    thread = threading.Thread(target=serve)
    thread.start()
    try:
        with context(client, ssl.PROTOCOL_TLS_CLIENT).wrap_socket(near) as wire:
            wire.sendall(b"word")
            if wire.recv(4) != b"word":
                wrong.append("no echo")
    except (ssl.SSLError, OSError) as error:
        wrong.append(str(error))
    finally:
        near.close()
        thread.join()
    return "; ".join(wrong)


@pytest.mark.parametrize("person", ["operator.alice", "observer.bob"])
def test_a_vehicle_and_its_people_shake_hands(ring: Path, person: str) -> None:
    assert handshake(ring / "vehicle.hawk", ring / person) == ""


def test_nobody_stands_in_for_a_vehicle(ring: Path) -> None:
    for person in ("observer.bob", "operator.alice"):
        assert "unsuitable certificate purpose" in handshake(ring / person, ring / "operator.alice")
    assert "unsuitable certificate purpose" in handshake(ring / "vehicle.hawk", ring / "vehicle.hawk")


def test_another_authoritys_are_strangers_on_either_side(ring: Path, foreign: Path) -> None:
    assert "verify failed" in handshake(ring / "vehicle.hawk", foreign / "operator.alice")
    assert "verify failed" in handshake(foreign / "vehicle.hawk", ring / "operator.alice")


def test_an_expired_one_is_refused(ring: Path) -> None:
    assert "certificate has expired" in handshake(ring / "vehicle.hawk", ring / "operator.late")


def test_a_clock_that_starts_in_the_past_refuses_nobody(ring: Path) -> None:
    for folder in ("vehicle.hawk", "operator.alice"):
        made = read_identity(ring / folder)
        assert made.cert.not_valid_before_utc == made.authority.not_valid_before_utc == BEGINS


def config(folder: Path, endpoint: str) -> zenoh.Config:
    return zenoh.Config.from_json5(zenoh_config(read_identity(folder), endpoint))


def connects(vehicle: Path, person: Path, endpoint: str) -> bool:
    with zenoh.open(config(vehicle, endpoint)) as listening:
        try:
            with zenoh.open(config(person, endpoint)) as dialling:
                return [str(found) for found in dialling.info.routers_zid() + dialling.info.peers_zid()] == [
                    str(listening.zid())
                ]
        except zenoh.ZError:
            return False


def test_zenoh_lets_in_its_own_and_no_stranger(ring: Path, foreign: Path, free_endpoint: str) -> None:
    endpoint = free_endpoint.replace("tcp/", "tls/")
    assert connects(ring / "vehicle.hawk", ring / "operator.alice", endpoint)
    assert connects(ring / "vehicle.hawk", ring / "observer.bob", endpoint)
    assert not connects(ring / "vehicle.hawk", foreign / "operator.alice", endpoint)
    assert not connects(ring / "vehicle.hawk", ring / "operator.late", endpoint)


def test_a_far_side_that_says_nothing_ends_no_process(ring: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        command = [sys.executable, "-c", "from goshawk_ground.cli import main; main()", "stop", "--timeout", "1"]
        command += ["--connect", f"tls/127.0.0.1:{silent.getsockname()[1]}", "--vehicle", "hawk"]
        command += ["--identity", str(ring / "operator.alice")]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2, done.stderr
    assert "Stop not delivered" in done.stderr.splitlines()[-1]


def test_without_a_place_for_a_socket_it_says_what_to_do(
    ring: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long = tmp_path / ("x" * 100)
    long.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(long))
    with pytest.raises(LinkError, match="TMPDIR"):
        Way("tls/127.0.0.1:7447", "hawk", ring / "operator.alice")


@pytest.mark.parametrize("address", ["127.0.0.1:99999", "127.0.0.1:0", "a..b:7447", f"{'a' * 64}.net:7447", "h:²"])
def test_an_address_that_cannot_be_one_is_refused(ring: Path, address: str) -> None:
    with pytest.raises(LinkError, match="is not an endpoint"):
        Way(f"tls/{address}", "hawk", ring / "operator.alice")


def test_the_ground_does_not_dial_a_revoked_vehicle(tmp_path: Path) -> None:
    folder = make_ring(tmp_path / "keys")
    endpoint = "tls/127.0.0.1:7447"
    Way(endpoint, "hawk", folder / "operator.alice").close()
    Keyring(folder=folder).revoke(Holder(role=Role.VEHICLE, name="hawk"))
    with pytest.raises(LinkError, match=r"vehicle\.hawk was revoked"):
        Way(endpoint, "hawk", folder / "operator.alice")
