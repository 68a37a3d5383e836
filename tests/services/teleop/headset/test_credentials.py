"""Token and certificate: made once, kept private, renewed when they no longer do."""

import os
from datetime import timedelta
from pathlib import Path

import pytest

pytest.importorskip("cryptography")
pytest.importorskip("segno")
pytest.importorskip("aiohttp")

from cryptography import x509

from services.teleop.errors import TeleopError
from services.teleop.headset import credentials
from services.teleop.headset.config import HeadsetConfig
from services.teleop.headset.credentials import own_names, prepare
from services.teleop.headset.serve import invitation


def lan(folder: Path, *names: str) -> HeadsetConfig:
    return HeadsetConfig(address="0.0.0.0", folder=folder, names=names)


def test_they_are_kept_and_only_their_owner_reads_the_secrets(tmp_path: Path) -> None:
    folder = tmp_path / "data"
    first, second = prepare(lan(folder)), prepare(lan(folder))
    assert (first.token, first.fingerprint) == (second.token, second.fingerprint)
    modes = {path.name: path.stat().st_mode & 0o777 for path in folder.iterdir()}
    assert modes["token"] == modes["key.pem"] == 0o600
    assert folder.stat().st_mode & 0o777 == 0o700


def test_loopback_needs_no_certificate(tmp_path: Path) -> None:
    made = prepare(HeadsetConfig(folder=tmp_path))
    assert made.context is None
    assert [path.name for path in tmp_path.iterdir()] == ["token"]


def test_the_certificate_names_every_address_and_is_renewed_for_a_new_one(tmp_path: Path) -> None:
    before = prepare(lan(tmp_path))
    after = prepare(lan(tmp_path, "robot.example", "192.0.2.7"))
    assert before.fingerprint != after.fingerprint
    certificate = x509.load_pem_x509_certificate((tmp_path / "certificate.pem").read_bytes())
    names = certificate.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    found = {str(name.value) for name in names}
    assert found >= {"robot.example", "192.0.2.7", "localhost", "127.0.0.1"}
    # One that names more than is needed still does.
    assert prepare(lan(tmp_path)).fingerprint == after.fingerprint


def test_it_is_renewed_before_it_ends(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(credentials, "LIFE", credentials.RENEWED_BEFORE - timedelta(days=1))
    ending = prepare(lan(tmp_path))
    monkeypatch.undo()
    renewed = prepare(lan(tmp_path))
    assert renewed.fingerprint != ending.fingerprint
    assert prepare(lan(tmp_path)).fingerprint == renewed.fingerprint


@pytest.mark.parametrize("damaged", ["certificate.pem", "key.pem"])
def test_a_damaged_or_lost_file_is_made_anew_or_reported(tmp_path: Path, damaged: str) -> None:
    prepare(lan(tmp_path))
    (tmp_path / damaged).unlink()
    prepare(lan(tmp_path))
    (tmp_path / damaged).write_text("damaged")
    if damaged == "certificate.pem":
        prepare(lan(tmp_path))
    else:
        with pytest.raises(TeleopError, match="certificate and token"):
            prepare(lan(tmp_path))


def test_a_new_token_makes_the_old_one_useless(tmp_path: Path) -> None:
    old = prepare(HeadsetConfig(folder=tmp_path))
    new = prepare(HeadsetConfig(folder=tmp_path), new_token=True)
    assert old.admits(old.token)
    assert not new.admits(old.token)
    assert new.admits(prepare(HeadsetConfig(folder=tmp_path)).token)


def test_a_token_that_was_cut_off_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "token").write_text("abc\n")
    assert len(prepare(HeadsetConfig(folder=tmp_path)).token) == 12


def test_a_folder_that_cannot_be_written_is_an_error_in_words(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(TeleopError, match=r"\[headset\] folder"):
        prepare(HeadsetConfig(folder=tmp_path / "file"))


def test_the_user_data_directory_is_the_usual_one(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert HeadsetConfig().data_folder == tmp_path / "trill" / "headset"
    monkeypatch.delenv("XDG_DATA_HOME")
    monkeypatch.setitem(os.environ, "HOME", str(tmp_path))
    assert HeadsetConfig().data_folder == tmp_path / ".local" / "share" / "trill" / "headset"


def test_the_invitation_says_how_to_get_in(tmp_path: Path) -> None:
    made = prepare(HeadsetConfig(folder=tmp_path))
    assert f"http://127.0.0.1:8443/#{made.token}" in invitation(made, 8443)
    secure = prepare(lan(tmp_path, "robot.example"))
    text = invitation(secure, 8443)
    assert f"https://robot.example:8443/#{secure.token}" in text
    assert secure.fingerprint in text


def test_names_come_with_what_the_user_gave_first() -> None:
    config = HeadsetConfig(address="0.0.0.0", names=("robot.example",))
    assert own_names(config)[0] == "robot.example"
    assert own_names(HeadsetConfig())[0] == "127.0.0.1"
