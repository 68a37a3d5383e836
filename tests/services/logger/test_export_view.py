"""A log is prepared for Rerun, and served to a browser on this machine only."""

import os
import threading
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import pytest

from services.logger.errors import ExportError
from services.logger.export.convert import Summary, export_log
from services.logger.view import rerun as view
from services.logger.view.webview import RECORDING, address_of, web_server
from tests.services.logger.export_support import session, write


@pytest.fixture
def served(tmp_path: Path) -> Iterator[str]:
    """Address of a server of a page and a recording that lies elsewhere."""
    (tmp_path / "log.rrd").write_bytes(b"a recording")
    folder = tmp_path / "served"
    folder.mkdir()
    (folder / "index.html").write_text("<p>page</p>")
    (folder / "viewer.wasm").write_bytes(b"")
    (folder / RECORDING).symlink_to(tmp_path / "log.rrd")
    with web_server(folder) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield address_of(server)
        server.shutdown()
        thread.join()


def test_the_page_names_a_recording_that_is_served(served: str) -> None:
    address = urlsplit(served)
    assert address.hostname == "127.0.0.1"
    (recording,) = parse_qs(address.query)["url"]
    with urllib.request.urlopen(recording) as answer:
        assert answer.read() == b"a recording"
    with urllib.request.urlopen(served) as answer:
        assert answer.read() == b"<p>page</p>"
        policy = answer.headers["Content-Security-Policy"]
    # A browser lets a page under this policy talk to its own server only.
    assert policy.startswith("default-src 'self' ")
    assert "http" not in policy
    assert "*" not in policy


def test_the_viewer_program_has_the_type_that_browsers_need(served: str) -> None:
    with urllib.request.urlopen(served.partition("?")[0] + "viewer.wasm") as answer:
        assert answer.headers["Content-Type"] == "application/wasm"


def test_other_files_are_not_served(served: str) -> None:
    for path in ("/log.rrd", "/../log.rrd", "/etc/passwd"):
        with pytest.raises(urllib.error.HTTPError, match="404"):
            urllib.request.urlopen(served.partition("/?")[0] + path)


def test_a_taken_port_is_named(served: str, tmp_path: Path) -> None:
    port = urlsplit(served).port
    assert port is not None
    with pytest.raises(ExportError, match=rf"127\.0\.0\.1:{port}: Address already in use.*--port"):
        web_server(tmp_path, port)


def prepare(log: Path, *, fresh: bool = False) -> Summary | None:
    return view.prepare(log, fresh=fresh, on_progress=lambda done, total: None)[1]


def test_a_recording_is_kept_until_the_log_grows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        view, "write_recording", lambda source, path, name, identity: path.write_text(name)
    )
    log = tmp_path / "log.mcap"
    write(log, session())
    os.utime(log, (1000.0, 1000.0))
    first = prepare(log)
    assert first is not None
    assert first.converted.total() == len(session())
    assert (tmp_path / "log-view.rrd").read_text() == f"{tmp_path.name}/log"
    assert prepare(log) is None
    assert prepare(log, fresh=True) is not None
    write(tmp_path / "log-2.mcap", session())
    os.utime(tmp_path / "log-view.rrd", (2000.0, 2000.0))
    again = prepare(log)
    assert again is not None
    assert again.converted.total() == 2 * len(session())
    assert {path.name for path in tmp_path.iterdir()} == {
        "log.mcap",
        "log-2.mcap",
        "log-view.rrd",
    }


def test_no_two_logs_have_the_same_identity(tmp_path: Path) -> None:
    (tmp_path / "containers").mkdir()
    (tmp_path / "later" / "containers").mkdir(parents=True)
    logs = [tmp_path / "containers" / name for name in ("a.mcap", "b.mcap")]
    logs.append(tmp_path / "later" / "containers" / "a.mcap")
    for log in logs:
        write(log, session()[:1])
    assert len({view.identity_of(log) for log in logs}) == 3
    assert view.identity_of(logs[0]) == view.identity_of(logs[0])


def test_rerun_reads_what_is_written(tmp_path: Path) -> None:
    pytest.importorskip("rerun", reason="needs the view extra")
    from rerun.chunk import RrdReader

    write(tmp_path / "log.mcap", session())
    export_log(tmp_path / "log.mcap", tmp_path / "out.mcap")
    view.write_recording(tmp_path / "out.mcap", tmp_path / "view.rrd", name="a run", identity="one")
    rows: dict[str, int] = {}
    static: set[str] = set()
    for chunk in RrdReader(tmp_path / "view.rrd").stream():
        if chunk.is_static:
            static |= {
                f"{chunk.entity_path} {name}" for name in chunk.to_record_batch().schema.names
            }
        if not chunk.is_static:
            rows[chunk.entity_path] = max(rows.get(chunk.entity_path, 0), chunk.num_rows)
    assert rows["/joints/measured/position"] == 20
    assert rows["/camera/left"] == 5
    assert rows["/events"] == 2
    assert rows["/plant/state"] == 20
    assert "/hands/left/setpoint Ellipsoids3D:half_sizes" in static
    assert sum("Mesh3D:vertex_positions" in one for one in static) > 25
