# SPDX-License-Identifier: MIT
"""Runs in MicroPython: the modelled chips on SPI, as their data sheets have it.

LSM9DS0 data sheet 6.2 and MPU-9250 product specification 7.5: while a chip is selected
the first byte holds the direction in bit 7 and the register below; of the LSM9DS0 bit 6
has the register count on.
"""

ADDRESSES = {"mpu9250": (0x68,), "lsm9ds0": (0x6B, 0x1D)}


class Select:
    """The chip select of one die."""

    def __init__(self, spi, address):
        self.spi = spi
        self.address = address

    def value(self, level):
        self.spi.select(self.address, level)


class FakeSPI:
    """`chip` answers on I2C; what is told of a transfer here must be right for SPI."""

    def __init__(self, chip, kind):
        self.chip = chip
        self.kind = kind
        self.selects = {at: Select(self, at) for at in ADDRESSES[kind]}
        self.selected = None
        self.head = None

    def select(self, address, level):
        assert (self.selected is None) is (level == 0)
        self.selected = address if level == 0 else None
        self.head = None

    def register(self, is_read, length):
        """Its number on I2C."""
        assert self.head >> 7 == is_read
        if self.kind == "mpu9250":
            return self.head & 0x7F
        counts_on = self.head >> 6 & 1
        assert counts_on or length == 1
        return self.head & 0x3F | counts_on << 7

    def write(self, data):
        if self.head is None:
            (self.head,) = data
            return
        register = self.register(False, len(data))
        if self.kind == "mpu9250" and register == 0x6A:
            assert data[0] & 0x10  # I2C_IF_DIS
            data = bytes((data[0] & ~0x10,))  # the model is on I2C nevertheless
        self.chip.writeto_mem(self.selected, register, data)

    def readinto(self, data):
        register = self.register(True, len(data))
        self.chip.readfrom_mem_into(self.selected, register, data)
