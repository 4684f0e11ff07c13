# SPDX-License-Identifier: MIT
"""Changes the params of a probe as one transaction: written part by part, checked and
put in force by the probe at once, or not at all.
"""

from __future__ import annotations

import asyncio
import re
from collections.abc import Mapping
from typing import Any

from imud.commands import COMMANDS
from imud.daemon.commands import Commander, shown
from imud.daemon.registry import ProbeEntry
from imud.errors import CommandRefused, DeviceError, NoReply, ParamsError
from imud.params.learned import filter_can_continue
from imud.params.parts import KINDS
from imud.params.value import Params
from imud.wire.params import words_of

# A word is in an EEPROM after 20 ms; a whole set is checked and switched to in 0.2 s.
POLL_S = 0.02
WORD_S = 5.0
APPLY_S = 20.0
VERIFY_S = 5.0
CHANGE_S = 60.0  # for all of it

GOES_ON = 256  # of params_apply, added to the length: the filter may continue

# Uploads of a set: what another host wrote in between damages it.
UPLOADS = 3

FAULTS = {1: "has the wrong length", 2: "is out of range", 3: "is given twice"}


class _Restarted(Exception):
    """The probe restarted during the change."""


class ParamsChange:
    """Brings records to probes, one set at a time to each."""

    def __init__(self, commander: Commander) -> None:
        self._commander = commander
        self._busy: set[ProbeEntry] = set()

    async def command(self, name: str, parameters: Mapping[str, str]) -> dict[str, Any]:
        """Puts the records of the parameters in force: `records` in hex, `probe`: the
        id of the probe that they are for, `force`=1: for another, too. DeviceError or
        ParamsError with the reason if it fails; then the params before hold.
        """
        entry = self._commander.entry_of(name)
        params = _asked(parameters)
        meant, probe_id = parameters.get("probe", ""), entry.probe.probe_id
        is_forced = parameters.get("force", "") == "1"
        if meant and meant != probe_id and not is_forced:
            raise CommandRefused(
                f"these params are from probe {shown(meant)}, but {name} is "
                f"{probe_id}; load them anyway with --force"
            )
        params.check()
        before = entry.probe.hello.get("params_digest")
        if entry in self._busy:
            raise CommandRefused(
                f"another client is changing the params of probe {name}; try again "
                "when it is done"
            )
        is_changed = params.digest != before
        if is_changed:
            self._busy.add(entry)
            try:
                async with asyncio.timeout(CHANGE_S):
                    await self._change(entry, params)
            except TimeoutError:
                raise DeviceError(
                    f"probe {name} did not accept the params within {CHANGE_S:g} s; "
                    "the old or the new set is active, never a mix"
                ) from None
            finally:
                self._busy.discard(entry)
        return {
            "digest": f"{params.digest:08x}",
            "before": f"{before:08x}" if isinstance(before, int) else None,
            "is_changed": is_changed,
        }

    async def _change(self, entry: ProbeEntry, params: Params) -> None:
        boots = entry.probe.account.boots
        flag = (
            GOES_ON if filter_can_continue(entry.probe.params, params.encode()) else 0
        )
        try:
            await self._bring(entry, params, boots, flag)
        except _Restarted:
            if entry.probe.hello.get("params_digest") != params.digest:
                raise DeviceError(
                    f"probe {entry.name} restarted while its params were changed: the "
                    "previous params stay active; try again"
                ) from None
        except NoReply as error:
            raise NoReply(
                f"{error}; the old or the new set is active, never a mix"
            ) from None
        # The sent params are active: their parts need not be received.
        entry.probe.params_parts.add_whole(params.encode())

    async def _bring(
        self, entry: ProbeEntry, params: Params, boots: int, flag: int
    ) -> None:
        records, digest = params.encode(), params.digest
        signed = digest - (1 << 32 if digest >> 31 else 0)
        for _ in range(UPLOADS):
            for word in words_of(records):
                result, _ = await self._ask(entry, boots, "params_write", word, WORD_S)
                _expect_taken(entry, result, len(records))
            result, value = await self._ask(
                entry, boots, "params_apply", (len(records) + flag, signed), APPLY_S
            )
            if result == "bad_argument" and flag:
                # Firmware without the flag: its filter restarts.
                flag = 0
                result, value = await self._ask(
                    entry, boots, "params_apply", (len(records), signed), APPLY_S
                )
            if result == "refused":
                tag, fault = value
                what = KINDS[tag].name if tag in KINDS else f"record {tag}"
                raise CommandRefused(
                    f"probe {entry.name} refused the params: {what} "
                    f"{FAULTS.get(fault, 'are invalid')}; the previous params stay "
                    "active"
                )
            if result != "damaged":
                _expect_taken(entry, result, len(records))
                await self._verify(entry, boots, digest)
                return
        raise CommandRefused(
            f"the params arrived damaged at probe {entry.name}, {UPLOADS} times; the "
            "previous params stay active; another host may be changing them as well"
        )

    async def _ask(
        self,
        entry: ProbeEntry,
        boots: int,
        command: str,
        arguments: tuple[int, int],
        patience_s: float,
    ) -> tuple[str, tuple[int, int]]:
        """The result and the value of a command, as soon as the probe is not busy."""
        loop = asyncio.get_running_loop()
        until_s = loop.time() + patience_s
        while True:
            try:
                message = await self._commander.ask(entry, command, arguments)
            except DeviceError:
                _check_boot(entry, boots)  # that is why, perhaps
                raise
            _check_boot(entry, boots)
            if message.fields["result"] != "busy":
                break
            if loop.time() > until_s:
                raise DeviceError(
                    f"probe {entry.name} was busy for {patience_s:g} s; the old or "
                    "the new set is active, never a mix"
                )
            await asyncio.sleep(POLL_S)
        value = message.fields["value"]
        numbers = value if isinstance(value, tuple) else (0, 0)
        return str(message.fields["result"]), (int(numbers[0]), int(numbers[1]))

    async def _verify(self, entry: ProbeEntry, boots: int, digest: int) -> None:
        """Waits for a hello that says that the params are in force."""
        loop = asyncio.get_running_loop()
        until_s = loop.time() + VERIFY_S
        while True:
            await self._ask(entry, boots, "hello", (0, 0), WORD_S)
            if entry.probe.hello.get("params_digest") == digest:
                return
            if loop.time() > until_s:
                raise DeviceError(
                    f"probe {entry.name} accepted the params, but its hello reports "
                    f"different ones; imud params show {entry.name} shows the active "
                    "ones"
                )
            await asyncio.sleep(POLL_S)


def _check_boot(entry: ProbeEntry, boots: int) -> None:
    if entry.probe.account.boots != boots:
        raise _Restarted


def _asked(parameters: Mapping[str, str]) -> Params:
    """The params that a command brings."""
    text = parameters.get("records")
    if text is None or not re.fullmatch(r"([0-9a-fA-F]{2})*", text):
        raise CommandRefused(COMMANDS["params"].usage)
    try:
        return Params.decode(bytes.fromhex(text))
    except ParamsError as error:
        raise CommandRefused(str(error)) from error


def _expect_taken(entry: ProbeEntry, result: str, size: int) -> None:
    """Raises the reason why a command was not carried out, if it was not."""
    if result == "ok":
        return
    if result == "failed":
        why = "its memory does not store what is written"
    elif result == "bad_argument":
        why = f"it has no room for {size} bytes"
    else:
        why = result.replace("_", " ")
    raise CommandRefused(
        f"probe {entry.name} did not accept the params: {why}; the previous params "
        "stay active"
    )
