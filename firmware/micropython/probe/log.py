# SPDX-License-Identifier: MIT
"""A log of the probe as files, on a card or in flash: the very frames that the wire
gets, for `imud decode`.
"""

from micropython import const

try:
    import os
except ImportError:  # a port without files
    os = None

_ENOSPC = const(28)
_UNKNOWN = const(-1)

# Enums of the protocol.
_LOG_STARTED = const(19)
_CARD_FAULT = const(17)
_CARD_FULL = const(18)
_CAUSE_BOOT = const(3)


class FileLog:
    """A file for each start of the program: imu-0001.bin and so on in `folder`. It has
    all frames but those of the last second before a power cut.
    """

    def __init__(self, folder="/sd"):
        self._folder = folder
        self._file = None
        self._number = 0
        self._error = 0

    def open(self, probe):
        """Begins the next file; where that fails, the probe continues without."""
        try:
            self._number = 1 + _last(os.listdir(self._folder))
            name = "{}/imu-{:04}.bin".format(self._folder, self._number)
            self._file = open(name, "wb")  # noqa: SIM115 - until close()
        except OSError as error:
            self._fail(error.errno)
            return
        probe.tell(_LOG_STARTED, _CAUSE_BOOT, self._number)

    def _fail(self, number):
        self._error = number or _UNKNOWN
        self.close()

    def write(self, data, at, length):
        if self._file is None or not length:
            return
        try:
            written = self._file.write(data, at, length)
        except OSError as error:
            self._fail(error.errno)
            return
        if written != length:
            self._fail(_ENOSPC)

    def step(self, probe):
        """Once a second: what is written stays, and a failure is told."""
        if self._file is not None:
            try:
                self._file.flush()
            except OSError as error:
                self._fail(error.errno)
        if self._error:
            event = _CARD_FULL if self._error == _ENOSPC else _CARD_FAULT
            self._error = 0
            probe.tell(event, 0, 0)

    def close(self):
        file, self._file = self._file, None
        if file is not None:
            try:
                file.close()
            except OSError:  # it has failed before, and is told
                pass


def _last(names):
    """The highest number of a log among file names; 0: there is none."""
    last = 0
    for name in names:
        digits = name[4:-4]
        if name.startswith("imu-") and name.endswith(".bin") and digits.isdigit():
            last = max(last, int(digits))
    return last
