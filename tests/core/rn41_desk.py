# SPDX-License-Identifier: MIT
"""An RN-41 as its guide describes it, and the driver with it on a desk."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Any

import native

ffi, lib = native.load()
STEP_US = 5000
BOOT_US = 400_000
SECOND_US = 1_000_000
NAME = "imu-probe-0e5f"
RIGHT = {"SN": NAME, "SU": "921K", "SM": "Slav", "ST": "0"}
FACTORY = {"SN": "FireFly-AB12", "SU": "115K", "SM": "Slav", "ST": "60"}
BAUDS = {"92": 921600, "11": 115200}
MODES = {"0": "Slav", "3": "Auto"}


class Module:
    """An RN-41, and the pins between it and the driver."""

    def __init__(self, settings: dict[str, str] | None = None) -> None:
        self.stored = dict(RIGHT if settings is None else settings)
        self.now_us = 0
        self.is_there = True
        self.is_mute = False
        self.answers_after_us = SECOND_US  # with CMD
        self.host_after_us: int | None = None  # connects each time, after a start
        self.link_at: list[tuple[int, bool]] = []
        self.host_sends: list[tuple[int, bytes]] = []
        self.is_linked = False
        self.keeps = lambda _name: True  # settings that it writes to its flash
        self.noise: Callable[[bytes], bytes] = lambda answer: answer
        self.writes: list[str] = []
        self.reboots = self.resets = 0
        self.is_in_reset = False
        self.is_commanding = False
        self.line_baud = 0
        self.to_driver: deque[tuple[int, int, bytes]] = deque()
        self.taken = 0  # bytes of its first
        self.sent: list[tuple[int, str]] = []  # by the driver, as it meant it
        self.gaps_us: list[int] = []  # before each $$$; a start counts as silence
        self.to_host = b""  # what reached who is connected
        self.boot()

    def boot(self) -> None:
        self.ready_us = self.now_us + BOOT_US
        self.settings = dict(self.stored)
        self.started_us = self.now_us
        self.heard_us = self.now_us - 10 * SECOND_US
        self.escape_us: int | None = None
        self.typed = ""
        self.is_commanding = self.is_linked = False

    @property
    def baud(self) -> int:
        return BAUDS[self.settings["SU"][:2]]

    @property
    def level(self) -> bool:
        """PIO2."""
        is_driven = self.is_there and not self.is_in_reset
        return self.is_linked if is_driven and self.now_us >= self.ready_us else True

    def say(self, text: str) -> None:
        if self.baud != self.line_baud:
            text = "\x80\xfe" * (len(text) // 2)
        self.to_driver.append(
            (self.now_us + 3000, self.line_baud, self.noise(text.encode("latin-1")))
        )

    def may_command(self) -> bool:
        timer = int(self.settings["ST"])
        is_early = self.now_us - self.started_us < timer * SECOND_US
        return is_early or timer >= 253 or not self.is_linked

    # The driver's side.

    def on_send(self, text: Any, length: int) -> None:
        data = bytes(ffi.buffer(text, length)).decode("latin-1")
        self.sent.append((self.now_us, data))
        if not self.is_there or self.is_in_reset or self.now_us < self.ready_us:
            return
        if data == "$$$":
            self.gaps_us.append(self.now_us - self.heard_us)
        if self.baud != self.line_baud:
            data = "\xff" * length
        for byte in data:
            self.take(byte)

    def take(self, byte: str) -> None:
        is_after_silence = self.now_us - self.heard_us >= SECOND_US
        self.heard_us = self.now_us
        if self.is_commanding:
            if byte == "\r":
                self.obey(self.typed)
                self.typed = ""
            else:
                self.typed += byte
            return
        if self.is_linked:
            self.to_host += byte.encode("latin-1")
        self.typed = byte if is_after_silence else self.typed + byte
        self.escape_us = self.now_us if self.typed == "$$$" else None

    def obey(self, command: str) -> None:
        name, _, value = command.partition(",")
        if command == "---":
            self.is_commanding = False
            self.say("END\r\n")
        elif command == "D":
            self.say(
                "***Settings***\r\nBTA=000666AB1234\r\n"
                f"BTName={self.stored['SN']}\r\nBaudrt(SW4)={self.stored['SU']}\r\n"
                f"Mode  ={self.stored['SM']}\r\nAuthen=1\r\n"
                "Bonded=0\r\nRem=NONE SET\r\n"
            )
        elif command == "E":
            self.say(
                "***ADVANCED Settings***\r\nSrvName= SPP\r\nSrvClass=0000\r\n"
                f"CfgTimer={self.stored['ST']}\r\nStatuStr=NULL\r\n"
            )
        elif command == "R,1":
            self.say("Reboot!\r\n")
            self.reboots += 1
            self.boot()
        elif name in self.stored and value:
            self.writes.append(command)
            if self.keeps(name):
                self.stored[name] = MODES[value] if name == "SM" else value
            self.say("AOK\r\n")
        else:
            self.say("?\r\n")

    def on_receive(self) -> int:
        if self.to_driver and self.to_driver[0][0] <= self.now_us:
            _, baud, data = self.to_driver[0]
            self.taken += 1
            if self.taken <= len(data):
                return data[self.taken - 1] if baud == self.line_baud else 0
            self.to_driver.popleft()
            self.taken = 0
            return self.on_receive()
        return -1

    def on_baud(self, baud: int) -> None:
        self.line_baud = baud

    def on_reset(self, is_held: bool) -> None:
        self.resets += is_held and not self.is_in_reset
        if self.is_in_reset and not is_held:
            self.to_driver.clear()
            self.taken = 0
            self.boot()
        self.is_in_reset = is_held

    # The rest of the world.

    def pass_time(self, us: int) -> None:
        self.now_us += us
        if self.is_there and not self.is_in_reset and self.now_us >= self.ready_us:
            host_us = self.host_after_us
            if host_us is not None and self.now_us - self.ready_us >= host_us:
                self.is_linked = True
            while self.link_at and self.link_at[0][0] <= self.now_us:
                self.is_linked = self.link_at.pop(0)[1]
            while self.host_sends and self.host_sends[0][0] <= self.now_us:
                _, data = self.host_sends.pop(0)
                self.to_driver.append((self.now_us, self.line_baud, data))
            if (
                self.escape_us is not None
                and self.now_us - self.escape_us >= self.answers_after_us
                and self.may_command()
                and not self.is_mute
            ):
                self.escape_us, self.typed = None, ""
                self.is_commanding = True
                self.say("CMD\r\n")


class Probe:
    """The driver, and the rest of the probe's main loop."""

    def __init__(self, module: Module, name: str = NAME, start_us: int = 0) -> None:
        self.module = module
        self.received = b""
        self.events: list[tuple[int, int]] = []
        self.states: list[int] = []
        module.now_us = start_us
        module.boot()
        port = {
            "send": ffi.callback("void(char *, uint8_t)", module.on_send),
            "receive": ffi.callback("int16_t(void)", module.on_receive),
            "set_baud": ffi.callback("void(uint32_t)", module.on_baud),
            "is_linked": ffi.callback("bool(void)", lambda: module.level),
            "hold_reset": ffi.callback("void(bool)", module.on_reset),
        }
        self.port = ffi.new("struct rn41_port *", port)
        self._keep = port
        self.rn41 = ffi.new("struct rn41 *")
        ffi.memmove(
            self.rn41, b"\xa5" * ffi.sizeof(self.rn41[0]), ffi.sizeof(self.rn41[0])
        )
        self.text = ffi.new("char[]", name.encode())
        lib.rn41_begin(self.rn41, self.port, self.text, start_us & 0xFFFFFFFF)
        self.note()

    def note(self) -> None:
        if not self.states or self.states[-1] != self.rn41.state:
            self.states.append(self.rn41.state)

    def step(self, us: int = STEP_US) -> None:
        module = self.module
        module.pass_time(us)
        event = lib.rn41_step(self.rn41, module.now_us & 0xFFFFFFFF)
        if event != lib.RN41_NOTHING:
            self.events.append((module.now_us, event))
        self.note()
        if self.rn41.state not in (lib.RN41_CONFIGURING, lib.RN41_FAILED):
            while (byte := module.on_receive()) >= 0:
                self.received += bytes([byte])

    def run(self, seconds: float) -> Probe:
        until = self.module.now_us + int(seconds * SECOND_US)
        while self.module.now_us < until:
            self.step()
        return self

    def run_to(self, state: int, seconds: float = 60) -> float:
        """Return after how many seconds the state was reached."""
        begun = self.module.now_us
        while self.rn41.state != state:
            assert self.module.now_us - begun < seconds * SECOND_US
            self.step()
        return (self.module.now_us - begun) / SECOND_US


def kinds(probe: Probe) -> list[int]:
    return [event for _, event in probe.events]
