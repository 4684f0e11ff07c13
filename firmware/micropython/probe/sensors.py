# SPDX-License-Identifier: MIT
"""The sensors that a probe may have, as main.py names them."""

from micropython import const

_MPU9250 = const(1)  # enum sensor of the protocol
_LSM9DS0 = const(3)
_LSM6DSOX = const(4)


class Sensor:
    """`bus`: a Bus, which can be freed, a machine.I2C, or an SPIBus."""

    def __init__(self, bus):
        self.i2c = getattr(bus, "i2c", bus)
        self.recover = getattr(bus, "recover", None)


class MPU9250(Sensor):
    """With its AK8963, pin AD0 low; 200 samples a second."""

    def attach(self, probe, ready):
        """To a Probe of the C module."""
        probe.attach(_MPU9250, self.i2c, ready, self.recover)

    def attach_plain(self, probe, ready):
        from .driver_mpu9250 import Driver

        probe.attach(Driver(), self.i2c, ready, self.recover)


class LSM6DSOX(Sensor):
    """With a LIS3MDL on the same bus, as on Adafruit's 4517; 208 samples a second. Or
    an LSM6DSV16X in its place, 200 a second.
    Its INT1 is the data-ready pin, or None: then it is asked. With the C module alone.
    """

    def attach(self, probe, ready):
        """To a Probe of the C module."""
        probe.attach(_LSM6DSOX, self.i2c, ready, self.recover)

    def attach_plain(self, _probe, _ready):
        # Its driver is tables that the C in core/drivers/part.c carries out, with the
        # self-test and two chips at two addresses. In Python it would be another one.
        raise ValueError("an LSM6DSOX needs the C module: docs/micropython.md")


class LSM9DS0(Sensor):
    """Its gyroscope's DRDY_G is the data-ready pin; 380 samples a second. `fast`: 760,
    with the C module.
    """

    def __init__(self, bus, gyr=0x6B, xm=0x1D, fast=False):
        super().__init__(bus)
        self.gyr = gyr
        self.xm = xm
        self.fast = fast

    def attach(self, probe, ready):
        """To a Probe of the C module."""
        probe.attach(
            *(_LSM9DS0, self.i2c, ready, self.recover),
            gyr=self.gyr,
            xm=self.xm,
            fast=self.fast,
        )

    def attach_plain(self, probe, ready):
        from .driver_lsm9ds0 import Driver

        probe.attach(Driver(self.gyr, self.xm), self.i2c, ready, self.recover)


def detected(bus):
    """The sensor on a bus, by its name: something else may be at 0x68."""
    i2c = getattr(bus, "i2c", bus)
    if not 0x70 <= _name(i2c, 0x68, 0x75) <= 0x74:
        for address in (0x6A, 0x6B):
            who = _name(i2c, address, 0x0F)
            if who == 0xD4:  # its gyroscope's
                return LSM9DS0(bus, gyr=address)
            if who:  # or it says who answers there
                return LSM6DSOX(bus)
    return MPU9250(bus)  # or waits for it


def _name(i2c, address, who_am_i):
    try:
        return i2c.readfrom_mem(address, who_am_i, 1)[0]
    except OSError:
        return 0
