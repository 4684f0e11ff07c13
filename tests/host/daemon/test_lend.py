# SPDX-License-Identifier: MIT
"""A probe's port, lent to another program and taken back."""

from __future__ import annotations

import pytest
import serial

from chain import Chain
from imud.commands import LENT_MAX_S
from imud.errors import CommandRefused, ImudError
from streaming import until


def is_free(chain: Chain) -> bool:
    """Whether another program may open the port for itself alone."""
    try:
        serial.Serial(str(chain.port.path), exclusive=True).close()
    except serial.SerialException:
        return False
    return True


def test_a_port_is_lent_and_comes_back_when_it_is_returned(chain: Chain) -> None:
    name = chain.probe.name
    assert not is_free(chain)
    reply = chain.client.command(name, "lend", seconds="60")
    assert reply["value"] == str(chain.port.path)
    assert is_free(chain)
    # Nothing else breaks, and the probe is known by its name.
    until(lambda: chain.client.statuses(name)[0]["state"] == "gone")
    assert chain.client.command(name, "lend", seconds="0")["ok"]
    until(lambda: not is_free(chain))

    def is_back() -> bool:
        # Again and again, as a probe does: the daemon may just open the port.
        chain.port.write(b"\0" + chain.probe.say("hello"))
        return bool(chain.client.statuses(name)[0]["state"] != "gone")

    until(is_back)


def test_a_port_that_nobody_returns_comes_back_by_itself(chain: Chain) -> None:
    chain.client.command(chain.probe.name, "lend", seconds="1")
    until(lambda: is_free(chain))
    until(lambda: not is_free(chain))


def test_the_port_of_old_firmware_is_lent_and_nothing_else_is_sent(
    chain: Chain,
) -> None:
    name = chain.probe.name
    chain.port.write(chain.probe.say("hello", schema_fingerprint=1))
    until(lambda: chain.client.statuses(name)[0]["state"] == "other schema")
    with pytest.raises(ImudError, match="update it with imud flash"):
        chain.client.command(name, "start")
    assert chain.client.command(name, "lend", seconds="60")["ok"]
    until(lambda: is_free(chain))


@pytest.mark.parametrize("seconds", ["", "-1", "2.5", str(LENT_MAX_S + 1), "\uff19"])
def test_only_a_number_of_seconds_is_taken(bench: Chain, seconds: str) -> None:
    with pytest.raises(CommandRefused, match="lend needs seconds=0 to 300"):
        bench.client.command(bench.probe.name, "lend", seconds=seconds)
    assert not is_free(bench)
