# SPDX-License-Identifier: MIT
"""Errors that a caller of imud may have to handle. Noise on the wire is counted, not
raised.

ImudError
├── ConfigError         a configuration file or an argument that makes no sense
├── ParamsError         params, or a file of them, that can't be
├── LinkError           a serial port
│   ├── PortNotFound
│   ├── PortBusy
│   ├── PortRefused     no permission, or not a serial port
│   └── PortLost
├── DeviceError         a probe
│   ├── ProbeUnknown    no such probe, or more than one to choose from
│   ├── VersionMismatch
│   ├── CommandRefused
│   └── NoReply
├── NetworkError        Zenoh
│   ├── ListenFailed
│   ├── NotAllowed      keys that don't let their user do that
│   └── DaemonNotFound
├── FileError           a capture or a log that can't be read or written
└── BuildFailed         C or images of a checkout, which had to be rebuilt

Each message says what was being done, to what, and what to do next, on one line.
"""

import errno
import os
import re


class ImudError(Exception):
    """Anything imud raises on purpose."""


class ConfigError(ImudError):
    """A configuration file or an argument that makes no sense."""


class ParamsError(ImudError):
    """Params, or a file of them, that can't be."""


class LinkError(ImudError):
    """A serial port that doesn't serve."""


class PortNotFound(LinkError):
    """No port of that name."""


class PortBusy(LinkError):
    """Another program holds the port."""


class PortRefused(LinkError):
    """No permission, or not a serial port."""


class PortLost(LinkError):
    """The port vanished while it was open."""


class DeviceError(ImudError):
    """A probe that doesn't do what it was asked."""


class FlashError(DeviceError):
    """A board that does not take its firmware."""


class ProbeUnknown(DeviceError):
    """No such probe, or more than one to choose from."""


class VersionMismatch(DeviceError):
    """The probe speaks another schema than this imud."""


class CommandRefused(DeviceError):
    """The probe answered that it will not."""


class NoReply(DeviceError):
    """The probe did not answer in time."""


class NetworkError(ImudError):
    """Zenoh can't be reached or opened."""


class ListenFailed(NetworkError):
    """The daemon can't listen where it was told to."""


class NotAllowed(NetworkError):
    """A user's keys don't let it do that."""


class DaemonNotFound(NetworkError):
    """No daemon answers there."""


class FileError(ImudError):
    """A capture or a log that can't be read or written."""


# What to do where the system refuses something, by its number.
_REMEDIES = {
    errno.EISDIR: "name a file that is in it",
    errno.ENOSPC: "what imud writes to is full: free space, or write elsewhere",
    errno.EROFS: "choose a folder that can be written to",
    errno.EMFILE: "imud may open too few files: allow more with ulimit -n 1024",
    errno.ENFILE: "this machine has too many files open: close other programs",
}


def told(error: BaseException) -> str:
    """What was refused, and what to do: the system, or the user, can change that."""
    if isinstance(error, MemoryError):
        return "out of memory; close other programs"
    if isinstance(error, UnicodeEncodeError):
        return "an argument is not UTF-8; type it again"
    why, cause = str(error), error.__cause__
    if isinstance(error, OSError):
        why, cause = error.strerror or reason(error), error
        if error.filename is not None:
            # A name that no file can have, or a folder without permission.
            why = f"can't use {error.filename}: {why}"
        elif "temporary directory" in why:
            return "no folder for temporary files: set TMPDIR to one that can be used"
    remedy = _REMEDIES.get(cause.errno or 0) if isinstance(cause, OSError) else None
    return f"{why}; {remedy}" if remedy and "; " not in why else why


def reason(fault: Exception) -> str:
    """What the system or a library says, without numbers and the file's name again."""
    if isinstance(fault, OSError) and fault.errno:
        return os.strerror(fault.errno)
    return re.sub(r"\[Errno -?\d+\] ", "", str(fault))


def described(fault: BaseException) -> str:
    """A fault of imud's own on one line: what, and where in imud."""
    place = ""
    trace = fault.__traceback__
    while trace is not None:
        code = trace.tb_frame.f_code
        if "imud" in code.co_filename:
            place = f" in {code.co_name}, line {trace.tb_lineno} of {code.co_filename}"
        trace = trace.tb_next
    words = " ".join(str(fault).split())
    return f"{type(fault).__name__}: {words}{place}"


class BuildFailed(ImudError):
    """A checkout's own C or images had to be built again, and that failed."""
