"""`goshawk keys` as its owner meets it: processes, folders, words, exit statuses."""

from __future__ import annotations

import json
import shutil
import stat
import subprocess
import sys
import tarfile
import tomllib
from datetime import UTC, datetime
from pathlib import Path

import pytest
from cryptography import x509
from goshawk_ground.keys.authority import read_key
from goshawk_ground.keys.chosen import default_identity, demo_identities
from goshawk_ground.keys.identity import read_identity, revoked_vehicles
from goshawk_ground.keys.keyring import Keyring
from goshawk_ground.keys.names import Holder, KeysError, Role

SUBJECTS = {"vehicle.hawk": "sslserver", "operator.alice": "sslclient", "observer.bob": "sslclient"}


@pytest.fixture
def home(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A user without a keyring; returns where it would be."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path / "config"))
    return tmp_path / "config/goshawk/keys"


def run(*arguments: object) -> subprocess.CompletedProcess[str]:
    command = [sys.executable, "-c", "from goshawk_ground.cli import main; main()", "keys", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def good(*arguments: object) -> str:
    done = run(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def refused(*arguments: object, status: int = 1) -> str:
    done = run(*arguments)
    assert (done.returncode, done.stdout) == (status, ""), done.stderr
    lines = done.stderr.strip().splitlines()
    assert len(lines) == 1, done.stderr
    return lines[0]


@pytest.fixture(scope="module")
def fresh_ring(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A keyring with one of each role, as the commands make it; not to be changed."""
    folder = tmp_path_factory.mktemp("fresh") / "keys"
    good("init", "--keys", folder)
    for subject in SUBJECTS:
        good(*subject.split("."), "--keys", folder)
    return folder


@pytest.fixture
def ring(fresh_ring: Path, home: Path) -> Path:
    """The user's keyring, with one of each role."""
    return shutil.copytree(fresh_ring, home)


def access(ring: Path, vehicle: str) -> dict[str, list[str]]:
    return tomllib.loads((ring / f"vehicle.{vehicle}/access.toml").read_text())


def test_nobody_else_can_read_a_keyring(ring: Path) -> None:
    modes = {path: stat.S_IMODE(path.stat().st_mode) for path in [ring, *ring.rglob("*")]}
    assert {mode for path, mode in modes.items() if path.is_dir()} == {0o700}
    assert {mode for path, mode in modes.items() if path.is_file()} == {0o600}
    assert ring / "vehicle.hawk/key.pem" in modes and ring / "ca-key.pem" in modes


def test_init_leaves_an_authority_that_is_there(ring: Path) -> None:
    before = (ring / "ca-key.pem").read_bytes()
    assert "has an authority already" in refused("init")
    assert (ring / "ca-key.pem").read_bytes() == before


@pytest.mark.parametrize("words", ["list", "vehicle hawk", "operator alice", "revoke alice", "config operator.alice"])
def test_without_a_keyring_it_says_how_to_make_one(home: Path, words: str) -> None:
    more = ["--connect", "tls/localhost:7447"] if words.startswith("config") else []
    assert "make one with: goshawk keys init" in refused(*words.split(), *more)


@pytest.mark.parametrize("name", ["Alice", "a.b", "a/b", "", "*", "a" * 33, "ünal"])
def test_what_no_key_may_hold_is_no_name(ring: Path, name: str) -> None:
    assert "is no name: use 1 to 32 of a-z" in refused("operator", name, status=2)


@pytest.mark.parametrize("subject", SUBJECTS)
def test_a_certificate_says_who_it_is_and_what_for(ring: Path, subject: str) -> None:
    cert = x509.load_pem_x509_certificate((ring / subject / "cert.pem").read_bytes())
    assert cert.version is x509.Version.v3
    assert cert.subject.rfc4514_string() == f"CN={subject}"
    assert cert.serial_number.bit_length() > 128
    assert cert.not_valid_before_utc == datetime(2020, 1, 1, tzinfo=UTC)
    days = (cert.not_valid_after_utc - datetime.now(UTC)).total_seconds() / 86400
    assert 364.9 < days < 365
    critical = {extension.oid.dotted_string for extension in cert.extensions if extension.critical}
    assert critical == {x509.BasicConstraints.oid.dotted_string, x509.KeyUsage.oid.dotted_string}
    assert (ring / subject / "key.pem").read_text().startswith("-----BEGIN PRIVATE KEY-----")


@pytest.mark.parametrize("subject", SUBJECTS)
def test_openssl_takes_each_for_its_own_purpose_alone(ring: Path, subject: str) -> None:
    assert shutil.which("openssl"), "install openssl"
    verdicts: dict[str, bool] = {}
    for purpose in ("sslserver", "sslclient"):
        command = ["openssl", "verify", "-x509_strict", "-purpose", purpose, "-CAfile", ring / "ca.pem"]
        done = subprocess.run([*command, ring / subject / "cert.pem"], capture_output=True, check=False)
        verdicts[purpose] = done.returncode == 0
    assert verdicts == {purpose: purpose == SUBJECTS[subject] for purpose in verdicts}


def test_a_new_person_is_admitted_everywhere_or_where_it_was_said(ring: Path) -> None:
    assert "it admits operator.alice, observer.bob" in good("vehicle", "kestrel")
    said = good("operator", "dora", "--vehicle", "kestrel")
    assert "vehicle.kestrel must be paired anew before it admits operator.dora" in said
    assert "vehicle.hawk" not in said
    assert access(ring, "hawk") == {"operators": ["alice"], "observers": ["bob"]}
    assert access(ring, "kestrel") == {"operators": ["alice", "dora"], "observers": ["bob"]}
    assert "there is no vehicle.nosuch" in refused("operator", "eve", "--vehicle", "nosuch")
    assert not (ring / "operator.eve").exists()


def test_renewing_changes_the_key_and_not_who_is_admitted(ring: Path) -> None:
    (ring / "vehicle.hawk/access.toml").write_text('operators = ["alice"]\nobservers = []\n')
    before = {s: (ring / s / "key.pem").read_bytes() for s in SUBJECTS}
    for subject in SUBJECTS:
        assert "--renew" in refused(*subject.split("."))
        assert (ring / subject / "key.pem").read_bytes() == before[subject]
        good(*subject.split("."), "--renew", "--days", 40)
        assert (ring / subject / "key.pem").read_bytes() != before[subject]
        read_identity(ring / subject)
    assert access(ring, "hawk") == {"operators": ["alice"], "observers": []}
    assert [path.name for path in ring.iterdir() if path.name.startswith(".")] == []
    assert "no operator.zoe to renew" in refused("operator", "zoe", "--renew")


def test_a_revoked_person_is_off_every_list_and_its_name_is_spent(ring: Path) -> None:
    good("vehicle", "kestrel")
    said = good("revoke", "bob")
    for vehicle in ("hawk", "kestrel"):
        assert access(ring, vehicle) == {"operators": ["alice"], "observers": []}
        assert f"vehicle.{vehicle} must be paired anew before it refuses observer.bob" in said
    assert (ring / "revoked/observer.bob/cert.pem").exists() and not (ring / "observer.bob").exists()
    assert "take another name" in refused("observer", "bob")
    assert "was revoked already" in refused("revoke", "bob")


def test_people_know_a_revoked_vehicle(ring: Path) -> None:
    said = good("revoke", "vehicle.hawk")
    good("operator", "dora")
    for person in ("operator.alice", "observer.bob", "operator.dora"):
        assert revoked_vehicles(ring / person) == {"hawk"}
    assert "goshawk keys export operator.alice" in said
    assert "take another name" in refused("vehicle", "hawk")


def test_a_name_with_two_roles_must_be_said_in_full(ring: Path) -> None:
    good("observer", "alice")
    assert "say which" in refused("revoke", "alice", status=2)
    good("revoke", "observer.alice")
    assert access(ring, "hawk") == {"operators": ["alice"], "observers": ["bob"]}


def test_list_says_who_expires_and_who_admits_whom_in_80_columns(ring: Path) -> None:
    good("operator", "a-long-name-of-32-characters-abc", "--days", 5)
    good("revoke", "bob")
    facts = json.loads(good("list", "--json"))
    rows = {f"{row['role']}.{row['name']}": row for row in facts["holders"]}
    assert rows["operator.alice"]["admitted_by"] == ["hawk"]
    assert rows["vehicle.hawk"]["operators"] == ["a-long-name-of-32-characters-abc", "alice"]
    assert rows["vehicle.hawk"]["paired"] is False
    assert len(rows["vehicle.hawk"]["sha256"]) == 64
    assert 4.8 < rows["operator.a-long-name-of-32-characters-abc"]["expires_days"] <= 5
    assert facts["revoked"] == ["observer.bob"]
    shown = good("list")
    assert max(map(len, shown.splitlines())) <= 80
    assert rows["vehicle.hawk"]["sha256"][:16] in shown and "revoked: observer.bob" in shown


def test_an_expired_identity_is_listed_as_such_and_not_paired(ring: Path, tmp_path: Path) -> None:
    keyring = Keyring(folder=ring)
    keyring.make(Holder(role=Role.VEHICLE, name="hawk"), datetime(2024, 1, 1, tzinfo=UTC), renew=True)
    assert "EXPIRED" in good("list")
    assert "goshawk keys vehicle hawk --renew" in refused("pair", "hawk", "--file", tmp_path / "hawk.tar")


def test_pairing_into_a_file_makes_all_that_is_missing(home: Path, tmp_path: Path) -> None:
    out = tmp_path / "hawk.tar"
    said = good("pair", "hawk", "--file", out)
    assert 'identity = "/etc/goshawk/identity"' in said
    assert "goshawk status --vehicle hawk --connect tls/HOST:7447" in said
    assert stat.S_IMODE(out.stat().st_mode) == 0o600
    target = tmp_path / "identity"
    target.mkdir()
    subprocess.run(["tar", "-xf", out, "-C", target, "--strip-components=1"], check=True)
    assert {path.name for path in target.iterdir()} == {"ca.pem", "cert.pem", "key.pem", "access.toml"}
    (me,) = home.glob("operator.*")
    assert access(home, "hawk")["operators"] == [me.name.removeprefix("operator.")]
    assert json.loads(good("list", "--json"))["holders"][1]["paired"] is True
    assert "is there already" in refused("pair", "hawk", "--file", out)
    good("operator", "dora")
    assert "pair it anew" in good("list")


def test_an_exported_identity_works_on_another_laptop(ring: Path, tmp_path: Path) -> None:
    out, other = tmp_path / "alice.tar", tmp_path / "other"
    good("export", "operator.alice", "--file", out)
    good("import", out, "--keys", other)
    assert (other / "operator.alice/key.pem").read_bytes() == (ring / "operator.alice/key.pem").read_bytes()
    assert stat.S_IMODE((other / "operator.alice/key.pem").stat().st_mode) == 0o600
    assert "--force" in refused("import", out, "--keys", other)
    good("import", out, "--keys", other, "--force")
    assert "made on the machine that has it" in refused("operator", "eve", "--keys", other)
    assert "begin a new one with --keys" in refused("init", "--keys", other)


def test_an_identity_of_another_authority_stays_out(ring: Path, tmp_path: Path) -> None:
    foreign, out = tmp_path / "foreign", tmp_path / "eve.tar"
    good("init", "--keys", foreign)
    good("operator", "eve", "--keys", foreign)
    good("export", "eve", "--file", out, "--keys", foreign)
    assert "of another authority" in refused("import", out)
    assert not (ring / "operator.eve").exists()


def repack(out: Path, folder: Path, owner: str = "operator.eve") -> Path:
    with tarfile.open(out, "w") as tar:
        for path in sorted(folder.iterdir()):
            tar.add(path, f"{owner}/{path.name}")
    return out


def test_import_refuses_a_key_or_an_authority_that_does_not_match(ring: Path, tmp_path: Path) -> None:
    folder = tmp_path / "mixed"
    shutil.copytree(ring / "operator.alice", folder)
    shutil.copy(ring / "observer.bob/key.pem", folder / "key.pem")
    out, other = tmp_path / "mixed.tar", tmp_path / "other"
    line = refused("import", repack(out, folder, "operator.alice"), "--keys", other)
    assert "the key does not belong to the certificate" in line and ".import-" not in line
    shutil.copy(ring / "operator.alice/key.pem", folder / "key.pem")
    assert "certificate is operator.alice's, not operator.eve's" in refused(
        "import", repack(out, folder), "--keys", other
    )
    good("init", "--keys", tmp_path / "foreign")
    shutil.copy(tmp_path / "foreign/ca.pem", folder / "ca.pem")
    assert "not signed by the authority beside it" in refused(
        "import", repack(out, folder, "operator.alice"), "--keys", other
    )
    (folder / "ca.pem").write_text("nothing")
    assert "holds no certificate" in refused("import", repack(out, folder, "operator.alice"), "--keys", other)
    assert list(other.iterdir()) == []


@pytest.mark.parametrize("name", ["../evil", "/etc/evil", "operator.eve/../../x", "operator.eve/sub/key.pem"])
def test_import_writes_nothing_of_a_tar_that_leads_elsewhere(home: Path, tmp_path: Path, name: str) -> None:
    out, victim = tmp_path / "evil.tar", tmp_path / "file"
    victim.write_text("evil")
    with tarfile.open(out, "w") as tar:
        tar.add(victim, name)
    assert "does not belong in an identity" in refused("import", out)
    assert not home.exists()


def test_import_refuses_links_and_what_is_no_tar(home: Path, tmp_path: Path) -> None:
    out = tmp_path / "link.tar"
    link = tmp_path / "key.pem"
    link.symlink_to("/etc/passwd")
    with tarfile.open(out, "w") as tar:
        tar.add(link, "operator.eve/key.pem")
    assert "does not belong in an identity" in refused("import", out)
    out.write_text("words")
    assert "is no tar file" in refused("import", out)
    assert "cannot use" in refused("import", tmp_path / "nosuch.tar")


def test_a_configuration_asks_for_the_side_that_fits(ring: Path) -> None:
    facts = good("config", "alice", "--connect", "tls/10.0.0.7:7447")
    assert f'"connect_private_key": "{ring}/operator.alice/key.pem"' in facts
    assert "say --connect tls/HOST:7447" in refused("config", "alice", "--listen", "tls/0.0.0.0:7447", status=2)
    assert "say --listen tls/HOST:7447" in refused("config", "hawk", status=2)
    assert "has no place for keys" in refused("config", "alice", "--connect", "tcp/10.0.0.7:7447")


def test_the_only_operator_is_chosen_and_two_must_be_told_apart(home: Path) -> None:
    assert default_identity() is None
    good("init")
    assert default_identity() is None
    good("observer", "bob")
    assert default_identity() == home / "observer.bob"
    good("operator", "alice")
    assert default_identity() == home / "operator.alice"
    good("operator", "carol")
    with pytest.raises(KeysError, match=r"2 operators: say which, as in --identity .*operator\.alice"):
        default_identity()


def test_a_demos_identities_are_whole_short_lived_and_not_in_the_keyring(home: Path, tmp_path: Path) -> None:
    vehicle, operator = map(read_identity, demo_identities(tmp_path / "demo"))
    assert (str(vehicle.who), str(operator.who)) == ("vehicle.goshawk", "operator.demo")
    assert vehicle.authority == operator.authority
    assert vehicle.access.operators == {"demo"}
    assert (vehicle.cert.not_valid_after_utc - datetime.now(UTC)).total_seconds() <= 86400
    assert not home.exists()
    assert [path.name for path in tmp_path.rglob("*ca-key*")] == []


def test_a_key_on_a_curve_that_nobody_knows_is_one_line(ring: Path) -> None:
    command = ["openssl", "ecparam", "-name", "wap-wsg-idm-ecid-wtls12", "-genkey", "-noout"]
    pem = subprocess.run(command, capture_output=True, check=True).stdout
    with pytest.raises(KeysError, match=r"key\.pem holds"):
        read_key(pem, "key.pem")
