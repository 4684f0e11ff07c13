# SPDX-License-Identifier: MIT
"""The main loop of a probe: sensor to probe, probe to wire, until it is interrupted."""

from time import ticks_diff, ticks_ms

import machine
from machine import Pin

from micropython import const, kbd_intr

from .board import facts
from .relay import Tee

_Module = None
_unfit = False
try:
    import imuprobe

    _Module = imuprobe.Probe
except (ImportError, AttributeError):  # a MicroPython without the module
    pass
except Exception:  # noqa: BLE001 - imuprobe.mpy of another processor, or no room
    _unfit = True

_WATCHDOG_MS = const(5000)
_HOOKS_MS = const(1000)
_DRAIN_MS = const(200)  # for the last frames before a reset
_CTRL_C = const(3)
_HOOK_FAILED = const(28)  # enum event of the protocol
_REJECTED = const(15)  # enum cause


def run(
    sensor,
    ready,
    wire,
    *,
    button=None,
    led=None,
    storage=None,
    supply=None,
    battery=None,
    log=None,
    hook=None,
    watchdog=True,
    plain=False,
):
    """Runs the probe: that of the C module or, where there is none or `plain` is true,
    one that sends raw samples for a host to fuse. It ends with an exception only.

    `sensor`: of sensors.py; `ready`: the Pin of its data-ready, None: there is no such
    wire, and the C module asks the sensor; `wire`: a UART, the
    USB_VCP, a UDP of udp.py, or another stream; `button`: a Pin that is low while it is
    pressed; `storage`: of storage.py, None: nothing is kept; `supply`: a function that
    returns the supply in mV; `battery`: of battery.py; `log`: of log.py; `hook`: a
    function that is called once a second. An exception of these four is told as the
    event hook_failed, and the probe continues.
    """
    kbd_intr(-1)  # a second call of run() has it back
    try:
        probe = _attached(sensor, ready, storage, plain)
        if _unfit:
            probe.tell(_HOOK_FAILED, _REJECTED, 0)
        if ready is not None:
            _listen(ready, probe.edge)
        hooks = Hooks(supply, battery, log, hook)
        _turn_for_ever(probe, wire, button, led, log, hooks, watchdog)
    finally:
        if log is not None:
            log.close()
        kbd_intr(_CTRL_C)
        if ready is not None:
            ready.irq(None)


def _attached(sensor, ready, storage, plain):
    if _Module is not None and not plain:
        probe = _Module(storage, **facts())
        sensor.attach(probe, ready)
        return probe
    if ready is None:
        raise ValueError("without the C module the sensor's data-ready needs a wire")
    from .plain import Probe

    probe = Probe(storage, **facts())
    sensor.attach_plain(probe, ready)
    return probe


def _listen(ready, edge):
    """As a hard interrupt, whose time is exact, where the port has them."""
    try:
        ready.irq(edge, Pin.IRQ_RISING, hard=True)
    except (TypeError, ValueError):
        ready.irq(edge, Pin.IRQ_RISING)


class Hooks:
    """The user's functions, called once a second."""

    def __init__(self, supply, battery, log, hook):
        self._supply = supply
        self._battery = battery
        self._log = log
        self._hook = hook
        self._failures = 0

    def call(self, probe):
        try:
            if self._supply is not None:
                probe.supply(self._supply())
            if self._battery is not None:
                self._battery.step(probe)
            if self._log is not None:
                self._log.step(probe)
            if self._hook is not None:
                self._hook()
        except Exception:  # noqa: BLE001 - whatever it is, it is told
            self._failures += 1
            probe.tell(_HOOK_FAILED, 0, self._failures)


def _turn_for_ever(probe, wire, button, led, log, hooks, watchdog):
    feed = machine.WDT(timeout=_WATCHDOG_MS).feed if watchdog else _nothing
    idle = machine.idle
    acquire, receive, step = probe.acquire, probe.receive, probe.step
    send, out = probe.send, wire
    if log is not None:
        log.open(probe)
        out = Tee(wire, log)
    if hasattr(out, "sender"):  # its write() is of MicroPython
        send = out.sender(probe)
    if hasattr(wire, "receiver"):
        receive = wire.receiver(probe)
    is_up = button.value if button is not None else _one
    light = led.value if led is not None else _nothing
    was_lit = None
    called_ms = ticks_ms()
    while True:
        worked = acquire()
        receive(wire)
        is_lit = step(not is_up())
        if is_lit is not was_lit:
            was_lit = is_lit
            light(is_lit)
        send(out)
        feed()
        if worked:
            continue
        if ticks_diff(ticks_ms(), called_ms) >= _HOOKS_MS:
            called_ms = ticks_ms()
            hooks.call(probe)
        if probe.wants_reset():
            _reset(send, out, wire, log)
        idle()


def _reset(send, out, wire, log):
    begun_ms = ticks_ms()
    txdone = getattr(wire, "txdone", None)
    while ticks_diff(ticks_ms(), begun_ms) < _DRAIN_MS:
        if send(out) == 0 and (txdone is None or txdone()):
            break
        machine.idle()
    if log is not None:
        log.close()
    machine.reset()


def _one():
    return 1


def _nothing(*_):
    return None
