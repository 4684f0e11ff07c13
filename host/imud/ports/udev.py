# SPDX-License-Identifier: MIT
"""The udev rules: ModemManager leaves our ports alone, and they have links.

Chips that may be anybody's are in no rule: a modem needs ModemManager.
"""

from __future__ import annotations

import re
from collections.abc import Iterable

from imud.ports.adapters import ADAPTERS
from imud.ports.adopted import AdoptedPort, is_unique

# After 60-serial.rules, which find ID_SERIAL and ID_PATH. The first marks adopted
# ports, the second makes the links of all.
ADOPTED_PLACE = "etc/udev/rules.d/69-imu-probe-adopted.rules"
PLACE = "etc/udev/rules.d/70-imu-probe.rules"

_HEAD = """\
# Boards that may be an imu-probe: ModemManager, which would write to them, leaves them
# alone. They and the ports that were adopted have links in /dev/imu-probe.
"""
_BOARD = """\

# {name}
SUBSYSTEM=="usb", ENV{{DEVTYPE}}=="usb_device", {match}, ENV{{ID_MM_DEVICE_IGNORE}}="1"
SUBSYSTEM=="tty", {parent}, ENV{{ID_MM_PORT_IGNORE}}="1", ENV{{IMU_PROBE}}="1"
"""
# Two links: of chips without a serial number several have one id.
_TAIL = """\

SUBSYSTEM=="tty", ENV{IMU_PROBE}=="1", ENV{ID_SERIAL}=="?*", \
SYMLINK+="imu-probe/by-id/$env{ID_SERIAL}-if$env{ID_USB_INTERFACE_NUM}"
SUBSYSTEM=="tty", ENV{IMU_PROBE}=="1", ENV{ID_PATH}=="?*", \
SYMLINK+="imu-probe/by-path/$env{ID_PATH}"
"""
_ADOPTED_HEAD = """\
# Ports that were adopted, by `imud ports`: left alone by ModemManager.
"""
_ADOPTED = """\
SUBSYSTEM=="tty", ATTRS{{idVendor}}=="{vendor}", ATTRS{{idProduct}}=="{product}", \
{which}, ENV{{ID_MM_PORT_IGNORE}}="1", ENV{{IMU_PROBE}}="1"
"""

# A device says its serial number itself: these characters mean nothing to udev.
_PLAIN = re.compile(r"[A-Za-z0-9_.:-]+")


def rules() -> str:
    """The rule for all boards, and the links."""
    return "".join((_HEAD, *_boards(), _TAIL))


def adopted_rules(ports: Iterable[AdoptedPort]) -> str:
    """The rule for adopted ports."""
    lines = []
    for port in ports:
        vendor, product, serial = (*port.adapter.split(":", 2), "", "")[:3]
        if not (re.fullmatch(r"[0-9a-f]{4}", vendor) and _is_plain(product)):
            continue  # Bluetooth
        if is_unique(serial) and _is_plain(serial):
            which = f'ATTRS{{serial}}=="{serial}"'
        elif _is_plain(port.place):
            which = f'ENV{{ID_PATH}}=="*{port.place}"'
        else:
            continue
        lines.append(_ADOPTED.format(vendor=vendor, product=product, which=which))
    return _ADOPTED_HEAD + "".join(lines)


def _boards() -> Iterable[str]:
    for adapter in ADAPTERS:
        if not adapter.is_board:
            continue
        ids = [("idVendor", f"{adapter.vendor:04x}")]
        if adapter.product is not None:
            ids.append(("idProduct", f"{adapter.product:04x}"))
        yield _BOARD.format(
            name=adapter.name,
            match=", ".join(f'ATTR{{{key}}}=="{value}"' for key, value in ids),
            parent=", ".join(f'ATTRS{{{key}}}=="{value}"' for key, value in ids),
        )


def _is_plain(text: str) -> bool:
    return _PLAIN.fullmatch(text) is not None
