# SPDX-License-Identifier: MIT
"""What happens to a daemon and its probes: each function is a kind of fault, and
returns for how many ns it lasts. draw() has some of them happen.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

from faults.world import KERNEL, MS, RECOVERED_NS, SLOW_HZ, Device, S, World

DAY = 86_400 * S


def long(world: World, least_ns: int, most_ns: int) -> int:
    """A duration: each order of magnitude is as likely."""
    return int(least_ns * (most_ns / least_ns) ** world.chance.random())


def _pass(world: World, ns: int, kept: int) -> None:
    """Time in which the daemon does not run, and the probes do."""
    for device in world.devices:
        device.skip(ns, kept if device.is_plugged else 0)
    world.pass_by(ns)


def _give(world: World) -> None:
    for device in world.devices:
        if device.link is not None:
            device.give_old()


def sleep(world: World, _: Device, most_ns: int = 8 * 3600 * S) -> int:
    """The machine sleeps, and its probes keep their power."""
    ns = long(world, 200 * MS, most_ns)
    _pass(world, ns, world.chance.choice((0, KERNEL)))
    world.slept_ns += ns
    _give(world)
    return 0


def naps(world: World, device: Device) -> int:
    for after_ns in (S // 2, S):
        world.at(after_ns, partial(sleep, world, device, 60 * S))
    return sleep(world, device) + 2 * S


def sleep_without_power(world: World, device: Device) -> int:
    sleep(world, device)
    for each in world.devices:
        each.restart()
    return 0


def paused_machine(world: World, _: Device) -> int:
    """A virtual machine is paused: none of its clocks counts that."""
    ns = long(world, S, 1200 * S)
    _pass(world, ns, 0)
    world.paused_ns += ns
    for each in world.devices:
        each.made.clear()  # of what was on the way
    return 0


def stopped(world: World, _: Device) -> int:
    """SIGSTOP, and SIGCONT."""
    _pass(world, long(world, 100 * MS, 60 * S), KERNEL)
    _give(world)
    return 0


def utc_is_set(world: World, _: Device) -> int:
    """Ahead, a little back, or far back."""
    ahead, back = long(world, 2 * MS, 400 * DAY), long(world, 2 * MS, 2 * S)
    world.utc_off_ns += world.chance.choice((ahead, -back, -back - ahead))
    return 0


def late_bytes(world: World, device: Device) -> int:
    device.late_ns = long(world, 10 * MS, S)
    world.at(3 * S, lambda: setattr(device, "late_ns", 0))
    return 3 * S


def unplugged(world: World, device: Device, keeps: int = 0) -> int:
    ns = long(world, 200 * MS, 20 * S)
    device.unplug(keeps)
    world.at(ns, lambda: setattr(device, "is_plugged", True))
    return ns + S


def old_bytes(world: World, device: Device) -> int:
    return unplugged(world, device, keeps=8192)


def restarted(_: World, device: Device) -> int:
    device.restart()
    return 0


def full_disk(world: World, _: Device) -> int:
    world.free_bytes = 0
    world.at(5 * S, lambda: setattr(world, "free_bytes", 1 << 40))
    return 8 * S


def killed(world: World, _: Device) -> int:
    world.kill()
    return 2 * S


def ended(world: World, _: Device) -> int:
    world.stop()
    return 2 * S


def renamed(world: World, device: Device) -> int:
    name = f"Stylus-{world.chance.randrange(100)}"
    if name not in (world.name_of(each.id) for each in world.devices):
        world.rename(device, name)
    return 0


def router_restarts(world: World, _: Device) -> int:
    world.is_router_down = True
    world.at(3 * S, lambda: setattr(world, "is_router_down", False))
    return 6 * S


def silent_console(world: World, device: Device) -> int:
    """Nobody reads stderr for a while, and there is something to tell."""
    device.restart()
    world.console.is_read.clear()
    world.at(5 * S, world.console.is_read.set)
    return 5 * S


def clock_leaps(world: World, device: Device) -> int:
    """The probe's clock gains some time at once."""
    device.born_ns -= long(world, 200 * MS, 600 * S)
    device.made.clear()
    return 0


KINDS: tuple[Callable[[World, Device], int], ...] = (
    *(sleep, naps, sleep_without_power, paused_machine, stopped),
    *(utc_is_set, late_bytes, unplugged, old_bytes, restarted, clock_leaps),
    *(full_disk, killed, ended, renamed, router_restarts, silent_console),
)


def draw(world: World, count: int) -> None:
    """Has `count` faults happen, one after the other, each in 10 s at a high rate."""
    if count == 0:
        world.end()
        return
    kind = world.chance.choice(KINDS)
    world.hz = world.fast_hz
    world.drawn.append(f"{kind.__name__} at {world.now_ns / S:.3f} s")
    lasts_ns = kind(world, world.chance.choice(world.devices))

    def judge() -> None:
        world.check()
        world.hz = SLOW_HZ
        world.at(world.chance.randrange(S), partial(draw, world, count - 1))

    world.at(lasts_ns + RECOVERED_NS, judge)
