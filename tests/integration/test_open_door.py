"""The open door of a real house: a password, TLS, and the owner's own programs, over the deaths of core and gateway."""

import datetime as dt
import http.client
import signal
import ssl
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID

from tests.integration.house import House, run_cli
from tests.waiting import until

PASSWORD = "canary-long-enough"


def certificate(folder: Path, serial: int) -> tuple[Path, Path]:
    """A certificate for this machine, signed by itself, and its key; written over one that is there."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "localhost")])
    now = dt.datetime.now(dt.UTC)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(serial)
        .not_valid_before(now - dt.timedelta(days=1))
        .not_valid_after(now + dt.timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.DNSName("localhost")]), critical=False)
        .sign(key, hashes.SHA256())
    )
    private = key.private_bytes(
        serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption()
    )
    cert_file, key_file = folder / "cert.pem", folder / "key.pem"
    cert_file.write_bytes(made.public_bytes(serialization.Encoding.PEM))
    key_file.write_bytes(private)
    return cert_file, key_file


def set_password(house: House, *words: str) -> str:
    """As its owner does, by standard input."""
    done = subprocess.run(
        [sys.executable, "-m", "hardcore.cli", "--data", str(house.data), "passwd", *words],
        env=house.environment(),
        input=PASSWORD.encode() + b"\n",
        capture_output=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr.decode()
    return done.stdout.decode()


def serial_of(house: House) -> int:
    """The number of the certificate that is shown to whoever connects."""
    host, port = house.url.removeprefix("https://").split(":")
    shown = ssl.get_server_certificate((host, int(port)), timeout=10)
    return x509.load_pem_x509_certificate(shown.encode()).serial_number


def ask(house: House, path: str, **headers: str) -> int:
    """Ask over TLS; return the status."""
    context = ssl.create_default_context()
    context.check_hostname, context.verify_mode = False, ssl.CERT_NONE
    host, port = house.url.removeprefix("https://").split(":")
    connection = http.client.HTTPSConnection(host, int(port), context=context, timeout=20)
    try:
        connection.request("GET", path, headers={"Host": "localhost", **headers})
        return connection.getresponse().status
    finally:
        connection.close()


@pytest.fixture
def house(tmp_path: Path) -> Iterator[House]:
    house = House(tmp_path / "data", {"spare": False})
    try:
        yield house
    finally:
        house.end()


def test_over_tls_and_a_password_the_house_survives_its_core_and_its_gateway(
    house: House, tmp_path: Path
) -> None:
    set_password(house)
    token = house.cli("token", "add", "script").out.splitlines()[1]
    cert, key = certificate(tmp_path, 1)
    launcher = house.begin(
        "--tls-cert",
        str(cert),
        "--tls-key",
        str(key),
        "--hostname",
        "localhost",
        "--policy",
        str(house.settle_policy()),
    )
    until(lambda: "https://localhost:" in house.said or launcher.poll() is not None, "`up` to say where")
    house.url = house.until(lambda s: s["core"]["ready"] and s["gateway"]["pid"], "a core to serve")["url"]
    bearer = {"Authorization": f"Bearer {token}"}
    assert ask(house, "/api/ledger/accounts") == 401
    assert ask(house, "/api/ledger/accounts", **bearer) == 200
    house.running()
    house.hit("core", signal.SIGKILL)
    assert ask(house, "/api/ledger/accounts", **bearer) == 200
    house.running()
    gateway = house.status()["gateway"]["pid"]
    house.hit("gateway", signal.SIGKILL)
    house.until(lambda s: s["gateway"]["pid"] not in {None, gateway}, "the next gateway")
    until(
        lambda: (
            [s["outcome"] for s in house.incidents() if s["diagnosis"] == "GATEWAY_LOST"] == ["recovered"]
        ),
        "its incident to close",
    )
    assert ask(house, "/api/ledger/accounts", **bearer) == 200
    assert '"ok": true' in house.cli("verify", "--json").out, "the owner's own programs need no password"
    certificate(tmp_path, 2)
    until(lambda: serial_of(house) == 2, "the renewed certificate to be shown")
    house.cli("token", "remove", "script")
    until(lambda: ask(house, "/api/ledger/accounts", **bearer) == 401, "the token to be refused")


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--host", "0.0.0.0"), "passwd"),
        (("--trusted-proxy", "10.0.0.5"), "passwd"),
        (("--trusted-proxy", "nowhere"), "10.0.0.0/8"),
        (("--host", "money.example"), "address"),
    ],
)
def test_a_door_that_is_not_safe_is_not_opened_and_the_next_step_is_said(
    house: House, words: tuple[str, ...], says: str
) -> None:
    done = house.cli("up", *words)
    assert (done.code, says in done.err) == (2, True), done


def test_with_a_password_alone_the_door_stays_shut_and_a_broken_certificate_is_told(
    house: House, tmp_path: Path
) -> None:
    set_password(house)
    plain = house.cli("up", "--host", "0.0.0.0")
    assert (plain.code, "--tls-cert" in plain.err) == (2, True)
    cert, key = certificate(tmp_path, 1)
    key.write_text("no key")
    assert house.cli("up", "--host", "0.0.0.0", "--tls-cert", str(cert), "--tls-key", str(key)).code == 2
    assert house.cli("up", "--tls-cert", str(cert)).code == 2


def test_passwords_and_tokens_are_kept_so_that_nobody_can_read_them(house: House) -> None:
    set_password(house)
    link = house.cli("passwd", "mina", "--link").out.splitlines()[-1]
    token = house.cli("token", "add", "script", "--scope", "read").out.splitlines()[1]
    kept = (house.folders.state / "access.json").read_text()
    assert (house.folders.state / "access.json").stat().st_mode & 0o777 == 0o600
    for secret in (PASSWORD, token, link.partition("key=")[2]):
        assert secret
        assert secret not in kept
    listed = house.cli("passwd", "--list").out
    assert "owner" in listed
    assert "mina" in listed
    assert house.cli("passwd", "--remove").code == 1, "a token is left"
    assert house.cli("token", "remove", "script").code == 0
    assert house.cli("passwd", "--remove").code == 1, "a link is left"
    assert house.cli("passwd", "mina", "--remove").code == 0
    assert house.cli("passwd", "--remove").code == 0
    assert run_cli("--data", str(house.data), "token", "add", "x", env=house.environment()).code == 1
