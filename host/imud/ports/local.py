# SPDX-License-Identifier: MIT
"""The ports of this machine, as a person sees them and says which are ours."""

from __future__ import annotations

from serial.tools import list_ports

from imud.config.settings import PortSettings
from imud.errors import PortNotFound, PortRefused
from imud.ports.adapters import Listed
from imud.ports.adopted import AdoptedPorts, file_of
from imud.ports.standing import PortRow, Standing, rows, same_port, standing_of


class LocalPorts:
    """Owned by its creator. Its calls read /proc and /sys: some
    milliseconds."""

    def __init__(self, settings: PortSettings) -> None:
        self._settings = settings
        self.adopted = AdoptedPorts(file_of(settings.memory))

    def rows(self) -> list[PortRow]:
        """All ports, sorted by name. FileError if the memory can't be read."""
        self.adopted.refresh()
        return list(rows(list_ports.comports(), self._settings, self.adopted))

    def adopt(self, name: str) -> bool:
        """Makes a port ours, and says whether it was not before."""
        port = self._listed(name)
        standing = standing_of(port, self._settings, self.adopted)
        reasons = {
            Standing.IGNORED: "[ports] ignore lists it",
            Standing.BUILT_IN: "it is not a USB port",
        }
        if (reason := reasons.get(standing)) is not None:
            raise PortRefused(
                f"{name} can't be adopted: {reason}; give it explicitly: imud run "
                f"{name}"
            )
        return self.adopted.adopt(port, "adopted by a user")

    def release(self, name: str) -> bool:
        """Leaves a port to others, and says whether it was ours."""
        return self.adopted.release(self._listed(name))

    def _listed(self, name: str) -> Listed:
        """The system's description of a port. PortNotFound if there is none."""
        for port in list_ports.comports():
            if same_port(port.device, name):
                return port
        raise PortNotFound(
            f"{name} is not a serial port of this machine; see imud ports"
        )
