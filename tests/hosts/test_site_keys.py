# SPDX-License-Identifier: MIT
"""Keys between sites: those of another site, and a certificate that expires."""

from __future__ import annotations

import datetime
from pathlib import Path

import pytest

from fakes import DaemonProcess, free_endpoint
from imud.client import Client
from imud.errors import DaemonNotFound
from imud.net import keys

DAY = datetime.timedelta(days=1)


def serving(directory: Path, folder: Path, endpoint: str) -> DaemonProcess:
    made = DaemonProcess(
        *(directory / "port", "--keys", folder),
        directory=directory,
        log=False,
        endpoint=endpoint.replace("tcp/", "tls/"),
    )
    made.expect("listens on")
    return made


def test_a_certificate_that_expired_is_renewed_without_new_files_for_users(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    endpoint = free_endpoint()
    number = int(endpoint.rpartition(":")[2])
    own, other = tmp_path / "own", tmp_path / "other"
    for folder in (own, other):
        keys.initialise(folder, ["localhost"], number)
    mine, theirs = (each / "clients" / "viewer.toml" for each in (own, other))
    with monkeypatch.context() as past:
        past.setattr(keys, "AFTER", -DAY / 2)
        assert keys.renew(own) < datetime.datetime.now(datetime.UTC)
    with serving(tmp_path, own, endpoint) as daemon:
        with pytest.raises(DaemonNotFound, match="does not admit viewer"):
            Client(keys=mine)
        daemon.stop()
    assert keys.renew(own) > datetime.datetime.now(datetime.UTC) + 1000 * DAY
    with serving(tmp_path, own, endpoint) as daemon:
        with pytest.raises(DaemonNotFound, match="does not admit viewer"):
            Client(keys=theirs)
        with Client(keys=mine) as client:
            assert client.is_connected
        daemon.stop()
