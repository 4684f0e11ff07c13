# SPDX-License-Identifier: MIT
"""Registers of the AK8963 in an MPU-9250, one at a time: by slave 4 of the chip's own
I2C master, which must be on.

Documents: RM = RM-MPU-9250A-00 rev 1.6, registers 49 to 54; AK = AK8963 data sheet
MS1356-E-02, 7.2.
"""

from time import ticks_diff, ticks_us

from micropython import const

_MPU9250 = const(0x68)
_AK8963 = const(0x0C)
_READ = const(0x80)  # of its address in SLV4_ADDR
_SLV4_ADDR = const(0x31)  # then REG, DO, CTRL
_SLV4_DI = const(0x35)
_MST_STATUS = const(0x36)
_DONE = const(0x40)
_NACK = const(0x10)
_ENABLE = const(0x80)
_TRANSFER_US = const(10_000)  # it starts with the next sample, after 5 ms at most

# What a transfer brings instead of a byte.
REFUSED = -1
UNFINISHED = -2


def ask(bus, register, value=None):
    """Begins to read a register, or to write this value to it."""
    address = _AK8963 if value is not None else _AK8963 | _READ
    request = bytes((address, register, value or 0, _ENABLE))
    bus.writeto_mem(_MPU9250, _SLV4_ADDR, request)


def answer(bus):
    """The byte that was read, after a write any; REFUSED, or UNFINISHED."""
    status = bus.readfrom_mem(_MPU9250, _MST_STATUS, 1)[0]
    if status & _NACK:
        return REFUSED
    if status & _DONE:
        return bus.readfrom_mem(_MPU9250, _SLV4_DI, 1)[0]
    return UNFINISHED


def transfer(bus, register, value=None):
    """Reads or writes a register. UNFINISHED: the AK8963 holds its bus."""
    ask(bus, register, value)
    begun = ticks_us()
    found = UNFINISHED
    while found == UNFINISHED and ticks_diff(ticks_us(), begun) <= _TRANSFER_US:
        found = answer(bus)
    return found
