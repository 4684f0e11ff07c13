# SPDX-License-Identifier: MIT
"""A serial port in an asyncio loop; one that vanished is opened again.

Opening, setting and closing it may wait: for seconds with a USB adapter that does not
answer, half a minute with a Bluetooth port. A thread of the link's own does these, one
after the other.
"""

from __future__ import annotations

import asyncio
import contextlib
import errno
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial

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

# A link that ends waits so long for its port to be closed.
CLOSE_S = 0.5

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
        self._waiter = ThreadPoolExecutor(1, f"imud {port}")
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
        if self._serial is not None:
            loop, port = asyncio.get_running_loop(), self._serial
            setting = self._waiter.submit(_set_baud, port, baud)
            setting.add_done_callback(partial(self._tell_set, loop))

    def _tell_set(self, loop: asyncio.AbstractEventLoop, setting: Future[bool]) -> None:
        """Called in the link's thread. A port that failed has vanished, or its driver
        lacks that rate and keeps the one before.
        """
        if not setting.cancelled() and not setting.result():
            with contextlib.suppress(RuntimeError):  # the loop has ended
                loop.call_soon_threadsafe(self._read)

    def _read(self) -> None:
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
                    self._close()  # done before the port is opened again
                    if isinstance(error, PortBusy | PortRefused):
                        pause_s = REFUSED_S
                    self._on_fault(error)
                await asyncio.sleep(pause_s)
        finally:
            closing = self._close()
            if closing is not None:
                await asyncio.wait([asyncio.wrap_future(closing)], timeout=CLOSE_S)
            self._waiter.shutdown(wait=False)

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
        port = self._serial = await self._opened()
        self._pending = b""
        if self._has_reset:
            await self._reset(port)
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

    def _close(self) -> Future[None] | None:
        if self._serial is None:
            return None
        self._unwatch()
        port, self._serial = self._serial, None
        return self._waiter.submit(_close, port)

    async def _opened(self) -> serial.Serial:
        """Opens the port; one that nobody waits for any more is closed again."""
        opening = self._waiter.submit(_open, self.port, self._baud)
        try:
            return await asyncio.wrap_future(opening)
        except asyncio.CancelledError:
            opening.add_done_callback(_close_unwanted)
            raise

    async def _reset(self, port: serial.Serial) -> None:
        """Resets a board by DTR."""
        for is_active in (False, True):
            await asyncio.wrap_future(self._waiter.submit(_set_dtr, port, is_active))
            if not is_active:
                await asyncio.sleep(RESET_S)


def _close(port: serial.Serial) -> None:
    system.drop_unsent(port)
    port.close()


def _close_unwanted(opening: Future[serial.Serial]) -> None:
    if not opening.cancelled() and opening.exception() is None:
        opening.result().close()


def _set_baud(port: serial.Serial, baud: int) -> bool:
    """Whether that succeeded."""
    try:
        port.baudrate = baud
        system.make_ours(port)
    except system.PORT_ERRORS:
        return False
    return True


def _set_dtr(port: serial.Serial, is_active: bool) -> None:
    """A pty and a Bluetooth port have none."""
    with contextlib.suppress(OSError):
        port.dtr = is_active


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
