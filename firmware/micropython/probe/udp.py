# SPDX-License-Identifier: MIT
"""A wire of signed datagrams to a daemon, over Wi-Fi: docs/micropython.md."""

import os
import select
import socket
import struct
from hashlib import sha256
from time import ticks_add, ticks_diff, ticks_ms

import machine

from micropython import const

from .plain_settings import id_of
from .relay import Relay

_HELLO, _WELCOME, _FROM_PROBE, _TO_PROBE = const(17), const(18), const(19), const(20)
_GREETING = "<B8s16s16s"
_GREETING_SIZE = const(41)
_NONCE = const(16)
_SIGNATURE = const(16)
_BLOCK = const(64)  # of SHA-256
_HEAD = const(13)  # kind, probe, counter
_FULL = const(_HEAD + 1400)
_DATAGRAM_MAX = const(1472)
_COUNTER_MAX = const(0x3FFFFFFF)  # a small integer; then another session begins

_POLL_MS = const(2)
_HOLD_MS = const(10)  # frames wait for others, as a datagram costs more than a frame
_GREET_MS = const(1000)  # between two hellos
_KNOWN = const(5)  # hellos to an address before the network is asked for another
_GONE_MS = const(3500)  # the daemon sends something every second

# All hosts of the network. A look-up of the host's name would take up to 7 s in lwIP,
# in which nothing else runs; the watchdog waits for 5.
EVERYBODY = "255.255.255.255"


class Signer:
    """HMAC-SHA256, RFC 2104, for a key of 32 bytes."""

    def __init__(self, key):
        key = key + bytes(_BLOCK - len(key))
        self._inner = bytes(byte ^ 0x36 for byte in key)
        self._outer = bytes(byte ^ 0x5C for byte in key)

    def digest(self, content):
        inner = sha256(self._inner)
        inner.update(content)
        outer = sha256(self._outer)
        outer.update(inner.digest())
        return outer.digest()

    def is_right(self, datagram):
        """Whether it ends with its signature; takes as long for any wrong one."""
        view = memoryview(datagram)
        right = self.digest(view[:-_SIGNATURE])
        difference = 0
        for n in range(_SIGNATURE):
            difference |= right[n] ^ view[n - _SIGNATURE]
        return difference == 0


class UDP(Relay):
    """To `imud` at `host`, or wherever in the network it answers, should its address
    change; `key`: the file that `imud keys probe` made. The board must have joined its
    network, or join it later.
    """

    def __init__(self, host, port=8736, key="probe.key"):
        super().__init__()
        self._names = (host, port), (EVERYBODY, port)
        self._unheard = 0  # hellos since the last welcome
        self._id = id_of(machine.unique_id())
        with open(key) as file:
            self._key = _unhex(file.read().strip())
        self._greeter = Signer(self._key)
        self._socket = None
        self._signer = None  # of a session
        self._nonce = b""
        self._polled = self._since = self._heard = ticks_ms()
        self._greeted = ticks_add(self._polled, -_GREET_MS)
        self._counter = 0
        self._taken = -1  # counter of the daemon's last datagram
        self._packet = bytearray(_FULL + _SIGNATURE)
        self._view = memoryview(self._packet)
        self._fill = _HEAD
        self._payload = b""
        self._at = 0

    def is_open(self):
        """Whether the daemon has answered, and is there."""
        self._poll()
        return self._signer is not None

    # What probes ask of a wire

    def any(self):
        self._poll()
        return len(self._payload) - self._at

    def readinto(self, one):
        one[0] = self._payload[self._at]
        self._at += 1

    def write(self, data, at, length):
        """Takes bytes while there is a session; they leave at _poll()."""
        if self._signer is None:
            return 0
        if self._fill == _HEAD:
            self._since = ticks_ms()
        length = min(length, _FULL - self._fill)
        end = self._fill + length
        self._packet[self._fill : end] = memoryview(data)[at : at + length]
        self._fill = end
        if end == _FULL:
            self._flush()
        return length

    def receiver(self, probe):
        """The replacement of probe.receive, with this object."""
        is_module = hasattr(probe, "take")
        return (lambda _: self._hand(probe.receive)) if is_module else probe.receive

    def txdone(self):
        """Whether all is sent; sends what can be."""
        self._flush()
        return self._fill == _HEAD

    def _hand(self, receive):
        if self.any():
            payload, self._payload = self._payload, b""
            receive(payload)

    # Datagrams

    def _poll(self):
        now = ticks_ms()
        if ticks_diff(now, self._polled) < _POLL_MS:
            return
        self._polled = now
        if self._signer is None:
            if ticks_diff(now, self._greeted) >= _GREET_MS:
                self._greet(now)
        elif ticks_diff(now, self._heard) > _GONE_MS or self._counter > _COUNTER_MAX:
            self._signer = None
        elif self._fill > _HEAD and ticks_diff(now, self._since) >= _HOLD_MS:
            self._flush()
        if self._socket is None or self._at < len(self._payload):
            return
        try:
            for _ in self._waiting.ipoll(0):
                datagram, address = self._socket.recvfrom(_DATAGRAM_MAX)
                self._take(datagram, address, now)
        except OSError:  # of a datagram before: nobody listens there
            pass

    def _greet(self, now):
        self._greeted = now
        self._nonce = os.urandom(_NONCE)
        content = struct.pack(_GREETING, _HELLO, self._id, self._nonce, bytes(_NONCE))
        hello = content + self._greeter.digest(content)[:_SIGNATURE]
        self._unheard += 1
        try:
            if self._socket is None:
                self._open()
            is_lost = self._unheard > _KNOWN and self._unheard % 2 == 0
            self._socket.sendto(hello, self._everybody if is_lost else self._host)
        except OSError:  # there is no network yet
            pass

    def _open(self):
        found = [socket.getaddrinfo(*name)[0][-1] for name in self._names]
        self._host, self._everybody = found
        opened = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        opened.setsockopt(socket.SOL_SOCKET, socket.SO_BROADCAST, 1)
        opened.setblocking(False)
        self._waiting = select.poll()
        self._waiting.register(opened, select.POLLIN)
        self._socket = opened

    def _take(self, datagram, address, now):
        """Take a datagram; one not signed for this session is ignored."""
        if len(datagram) < _HEAD + _SIGNATURE or datagram[1:9] != self._id:
            return
        if datagram[0] == _WELCOME:
            self._agree(datagram, address, now)
        elif self._signer is not None and datagram[0] == _TO_PROBE:
            (counter,) = struct.unpack_from("<I", datagram, 9)
            if counter > self._taken and self._signer.is_right(datagram):
                self._taken = counter
                self._heard = now
                self._payload = datagram[_HEAD:-_SIGNATURE]
                self._at = 0

    def _agree(self, datagram, address, now):
        is_whole = len(datagram) == _GREETING_SIZE + _SIGNATURE
        if not is_whole or not self._greeter.is_right(datagram):
            return
        if not self._nonce or datagram[9:25] != self._nonce:
            return
        self._nonce = b""  # one session for a hello
        self._host = address
        self._unheard = 0
        self._signer = Signer(self._greeter.digest(b"imud" + datagram[1:41]))
        self._counter = 0
        self._taken = -1
        self._heard = now

    def _flush(self):
        """Sends the whole frames that wait; the rest stays."""
        end = self._fill
        while end > _HEAD and self._packet[end - 1]:
            end -= 1
        if end == _HEAD or self._signer is None:
            return
        rest = bytes(self._view[end : self._fill])
        head = _FROM_PROBE, self._id, self._counter
        struct.pack_into("<B8sI", self._packet, 0, *head)
        signature = self._signer.digest(self._view[:end])[:_SIGNATURE]
        self._packet[end : end + _SIGNATURE] = signature
        try:
            self._socket.sendto(self._view[: end + _SIGNATURE], self._host)
            self._counter += 1
            self._fill = _HEAD + len(rest)
            self._packet[_HEAD : self._fill] = rest
        except OSError:  # no network for now: they are sent again
            self._packet[end : end + len(rest)] = rest
            self._since = ticks_ms()


def _unhex(text):
    return bytes(int(text[n : n + 2], 16) for n in range(0, len(text), 2))
