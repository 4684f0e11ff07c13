# SPDX-License-Identifier: MIT
"""Sockets of a board without a network, over its USB: lines of hexadecimal digits that
begin with MARK, which tests/system/test_pico_wifi.py carries to and from sockets.
"""

import io
import select
import sys
from binascii import hexlify, unhexlify

AF_INET, SOCK_DGRAM, SOL_SOCKET, SO_BROADCAST = range(4)
MARK = "\x1e"
POLL, READABLE = 3, 1  # of MicroPython's streams

usb = select.poll()
usb.register(sys.stdin, select.POLLIN)


def getaddrinfo(host, port):
    return [(AF_INET, SOCK_DGRAM, 0, "", (host, port))]


class socket(io.IOBase):  # noqa: N801 - the name that it stands for
    def __init__(self, *_):
        self._line = b""

    def setsockopt(self, *_):
        pass

    setblocking = setsockopt

    def sendto(self, datagram, _address):
        sys.stdout.write(f"{MARK}{hexlify(datagram).decode()}\n")

    def ioctl(self, request, _flags):
        while request == POLL and not self._line.endswith(b"\n") and usb.poll(0):
            self._line += sys.stdin.buffer.read(1)
        return READABLE if self._line.endswith(b"\n") else 0

    def recvfrom(self, _size):
        line, self._line = self._line, b""
        return unhexlify(line.strip()[1:]), None
