# SPDX-License-Identifier: MIT
"""Sensors on SPI: registers are read and written as over I2C, those of an AK8963 by the
I2C master of the MPU-9250 that it is in.

Documents: DS = LSM9DS0 data sheet, DocID024763 rev 2, 6.2; PS = MPU-9250 product
specification, PS-MPU-9250A-01 rev 1.1, 7.5; RM = RM-MPU-9250A-00 rev 1.6.
"""

from micropython import const

from .ak8963 import REFUSED, transfer

_READ = const(0x80)  # of the first byte: DS 6.2, PS 7.5
_AUTO_I2C = const(0x80)  # a driver's wish that the LSM9DS0 counts on, DS 6.1.1
_AUTO_SPI = const(0x40)  # the same on SPI, DS 6.2; the MPU-9250 always does
_LSM9DS0_LAST = const(0x3F)  # register

_MPU9250 = const(0x68)
_USER_CTRL = const(0x6A)
_I2C_IF_DIS = const(0x10)  # it must not take traffic of SPI for that of I2C, RM 106
_I2C_MST_EN = b"\x20"
_AK8963 = const(0x0C)  # on I2C; it has no SPI
_ENODEV = const(19)
_ETIMEDOUT = const(110)


class SPIBus:
    """`spi`: a machine.SPI of mode 3 (polarity=1, phase=1) at 1 MHz at most, PS 7.5;
    `selects`: the Pin of a chip select, which is high, by the address that its chip has
    on I2C.
    """

    def __init__(self, spi, selects):
        self._spi = spi
        self._selects = selects
        self._head = bytearray(1)

    def _begin(self, address, register, flag):
        if register & _AUTO_I2C:
            register = register & _LSM9DS0_LAST | _AUTO_SPI
        self._head[0] = register | flag
        select = self._selects[address]
        select.value(0)
        self._spi.write(self._head)
        return select

    def readfrom_mem_into(self, address, register, data):
        """Reads registers from this one on; nothing is allocated, but for an AK8963."""
        if address == _AK8963:
            for at in range(len(data)):
                data[at] = self._transfer(register + at)
            return
        select = self._begin(address, register, _READ)
        self._spi.readinto(data)
        select.value(1)

    def readfrom_mem(self, address, register, length):
        data = bytearray(length)
        self.readfrom_mem_into(address, register, data)
        return data

    def writeto_mem(self, address, register, data):
        if address == _AK8963:
            for at in range(len(data)):
                self._transfer(register + at, data[at])
            return
        if address == _MPU9250 and register == _USER_CTRL:
            data = bytes((data[0] | _I2C_IF_DIS,))
        select = self._begin(address, register, 0)
        self._spi.write(data)
        select.value(1)

    def _transfer(self, register, value=None):
        """One register of the AK8963, by the MPU-9250's master."""
        self.writeto_mem(_MPU9250, _USER_CTRL, _I2C_MST_EN)
        found = transfer(self, register, value)
        self.writeto_mem(_MPU9250, _USER_CTRL, b"\x00")
        if found < 0:
            raise OSError(_ENODEV if found == REFUSED else _ETIMEDOUT)
        return found
