# SPDX-License-Identifier: MIT
"""A serial port in an asyncio loop; one that vanished is opened again."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import threading
from collections.abc import Callable
from pathlib import Path

import serial

from imud.errors import LinkError, PortBusy, PortLost, PortNotFound, PortRefused
from imud.machine import system
from imud.probes.timeline import host_ns

# A port that does not exist is tried this often, which takes 10 us each time: a probe
# is back before its next hello.
RETRY_S = 0.15

# A port that is in use or can't be opened is tried less often.
REFUSED_S = 0.5

# DTR goes active at its end; an Arduino's capacitor turns that into a reset of 0.1 ms.
RESET_S = 0.05

# Bytes that may wait to be written, for a probe that reads none: dozens of commands.
PENDING_MAX = 4096


class Link:
    """Keeps one port open. Its callbacks run in the thread of the loop."""

    def __init__(
        self,
        port: str,
        baud: int,
        *,
        on_open: Callable[[], None],
        on_data: Callable[[bytes, int], None],
        on_fault: Callable[[LinkError], None],
        has_reset: bool = False,
    ) -> None:
        self.port = port
        self._baud = baud
        self._on_open = on_open
        self._on_data = on_data
        self._on_fault = on_fault
        self._has_reset = has_reset
        self._serial: serial.Serial | None = None
        self._watch: system.SerialWatch | None = None
        self._pending = b""
        self._lost: asyncio.Future[LinkError] | None = None

    @property
    def is_open(self) -> bool:
        return self._serial is not None

    @property
    def baud(self) -> int:
        return self._baud

    def set_baud(self, baud: int) -> None:
        """Changes the rate of the open port; opening it again would reset a board."""
        if baud == self._baud:
            return
        self._baud = baud
        if self._serial is None:
            return
        try:
            self._serial.baudrate = baud
            system.make_ours(self._serial)
        except system.PORT_ERRORS:
            # It vanished, or its driver lacks that rate and keeps the one before.
            if self._watch is not None:
                self._watch.read()

    async def run(self) -> None:
        """Opens the port, again and again, until it is cancelled."""
        try:
            while True:
                pause_s = RETRY_S
                try:
                    await self._serve()
                except LinkError as error:
                    self._close()
                    if isinstance(error, PortBusy | PortRefused):
                        pause_s = REFUSED_S
                    self._on_fault(error)
                await asyncio.sleep(pause_s)
        finally:
            self._close()

    def write(self, data: bytes) -> None:
        """Sends bytes as the port accepts them; PortLost if it is not open."""
        if self._serial is None:
            raise PortLost(f"{self.port} is not open; plug it in, or wait")
        if len(self._pending) + len(data) > PENDING_MAX:
            raise PortLost(
                f"{self.port} accepts no bytes; unplug it and plug it in again"
            )
        self._pending += data
        self._write_some()

    async def _serve(self) -> None:
        port = self._serial = await _opened(self.port, self._baud)
        self._pending = b""
        if self._has_reset:
            await _reset(port)
        loop = asyncio.get_running_loop()
        self._lost = loop.create_future()
        self._watch = system.SerialWatch(port, host_ns, self._on_data, self._hang_up)
        self._on_open()
        raise await self._lost

    def _write_some(self) -> None:
        if self._watch is None:
            return
        try:
            written = self._watch.write(self._pending, self._write_some)
        except OSError:
            self._hang_up()
            return
        self._pending = self._pending[written:]

    def _hang_up(self) -> None:
        # At once: a descriptor that hung up stays readable.
        self._unwatch()
        if self._lost is not None and not self._lost.done():
            self._lost.set_result(
                PortLost(f"{self.port} disappeared; imud opens it when it returns")
            )

    def _unwatch(self) -> None:
        watch, self._watch = self._watch, None
        if watch is not None:
            watch.end()

    def _close(self) -> None:
        if self._serial is None:
            return
        self._unwatch()
        port, self._serial = self._serial, None
        system.drop_unsent(port)
        port.close()


async def _opened(name: str, baud: int) -> serial.Serial:
    """Opens a port. That of Bluetooth connects first, which takes up to half a minute
    where nobody answers: in a thread, that is left alone once nobody waits for it.
    """
    if not Path(name).name.startswith("rfcomm"):
        return _open(name, baud)
    loop = asyncio.get_running_loop()
    done: asyncio.Future[serial.Serial] = loop.create_future()

    def settle(port: serial.Serial | None, error: Exception | None) -> None:
        if done.cancelled():
            if port is not None:
                port.close()
        elif port is not None:
            done.set_result(port)
        elif error is not None:
            done.set_exception(error)

    def work() -> None:
        port, error = None, None
        try:
            port = _open(name, baud)
        except Exception as fault:  # noqa: BLE001 - raised in the loop
            error = fault
        with contextlib.suppress(RuntimeError):  # the loop has ended
            loop.call_soon_threadsafe(settle, port, error)

    threading.Thread(target=work, name=f"open {name}", daemon=True).start()
    return await done


def _open(name: str, baud: int) -> serial.Serial:
    try:
        # exclusive: two readers would each get some of the bytes.
        port = serial.Serial(name, baud, timeout=0, exclusive=True)
    except serial.SerialException as error:
        raise _translated(name, error) from error
    except system.PORT_ERRORS as error:
        raise PortRefused(
            f"{name} can't be set to {baud} baud; check that it is a serial port"
        ) from error
    try:
        system.make_ours(port)
    except OSError as error:
        port.close()
        raise PortLost(f"{name} disappeared; imud opens it when it returns") from error
    _ask_for_low_latency(port)
    system.keep_others_out(port, name)
    return port


def _ask_for_low_latency(port: serial.Serial) -> None:
    """Has an FTDI chip send received bytes after 1 ms instead of 16 ms, by the flag
    that Linux's driver `ftdi_sio` knows. Needs no privilege. Drivers without it (ptys,
    CDC ACM) and other systems refuse it or ignore it.
    """
    # pyserial: the driver refuses; the system has no such flag.
    with contextlib.suppress(ValueError, NotImplementedError):
        port.set_low_latency_mode(True)


async def _reset(port: serial.Serial) -> None:
    """Resets a board by DTR; a pty and a Bluetooth port have none."""
    with contextlib.suppress(OSError):
        port.dtr = False
        await asyncio.sleep(RESET_S)
        port.dtr = True


def _translated(name: str, error: serial.SerialException) -> LinkError:
    code = error.errno
    if code in (errno.ENOENT, errno.ENODEV, errno.ENXIO):
        return PortNotFound(f"{name} does not exist; imud opens it when it appears")
    if code in (errno.EBUSY, errno.EAGAIN):
        return PortBusy(
            f"{name} is in use by another program; imud opens it when it is free"
        )
    if code in (errno.EACCES, errno.EPERM):
        return PortRefused(
            f"no permission to open {name}; join its group: sudo usermod -a -G "
            "dialout $USER, and log in again"
        )
    if code == errno.EIO:
        return PortNotFound(f"{name} has no other end; imud opens it when it has one")
    return PortRefused(f"{name} can't be opened; check that it is a serial port")
