# SPDX-License-Identifier: MIT
"""Client: poses and commands over the network, without serial port or protocol.

Most programs want `subscribe()`, which is built on it: docs/subscribe.md.
"""

from __future__ import annotations

import json
import queue
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import zenoh
import zenoh.ext

from imud.defaults import ENDPOINT, PREFIX
from imud.endpoint import KEY, unfit
from imud.errors import CommandRefused, ConfigError, NoReply, NotAllowed, ProbeUnknown
from imud.net import access, network

QUERY_TIMEOUT_S = 2.0

# Within milliseconds of a session's first query, Zenoh 1.10 leaves tokens out of some
# answers: after an empty answer, ask again after these pauses. The history that a
# liveliness subscriber gets is such an answer too: wait_for() also queries, so often.
ALIVE_PAUSES_S = (0.0, 0.05, 0.1)
ALIVE_AGAIN_S = 0.5

# The daemon tries a command three times, for a second each.
COMMAND_TIMEOUT_S = 4.0

# It gives up a change of params after a minute.
PARAMS_TIMEOUT_S = 70.0


@dataclass(frozen=True, slots=True)
class Delivery:
    """One payload as it arrived on a key."""

    probe: str  # its name then
    payload: bytes
    source: str  # id of the Zenoh session that published it; changes with a restart
    probe_id: str = ""  # empty: the publisher does not say it


class Client:
    """A connection to a daemon. Use it in a `with`, or close() it.

    `keys` is the clients/NAME.toml of `imud keys`. DaemonNotFound if no daemon is at
    `endpoint`.
    """

    def __init__(
        self,
        endpoint: str = ENDPOINT,
        prefix: str = PREFIX,
        keys: str | Path | None = None,
    ) -> None:
        if not KEY.fullmatch(prefix):
            raise ConfigError(unfit(prefix, PREFIX))
        self._prefix = prefix
        self._mine = network.read_credentials(Path(keys)) if keys is not None else None
        if self._mine is not None and endpoint == ENDPOINT:
            endpoint = (
                self._mine.endpoint
            )  # unless an argument says where the daemon is
        self._endpoint = endpoint
        self._session = network.open_client(endpoint, self._mine)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        self._session.close()

    @property
    def endpoint(self) -> str:
        return self._endpoint

    @property
    def session(self) -> zenoh.Session:
        """The Zenoh session, for what this class does not offer."""
        return self._session

    @property
    def is_connected(self) -> bool:
        """False while the daemon is away; Zenoh reconnects when it is back."""
        return network.is_connected(self._session)

    def may(self, do: str) -> bool:
        """Whether the role of its keys may read this topic, send commands (`command`),
        or send that one (`cmd/NAME`).
        """
        return self._mine is None or self._mine.role in access.who_may(do)

    def check_may(self, do: str) -> None:
        """Raises NotAllowed if may() is false: the daemon denies without a reply."""
        mine = self._mine
        if mine is None or self.may(do):
            return
        is_command = do == access.COMMAND or do.startswith(access.CMD)
        what = access.COMMAND if is_command else f"read {do}"
        raise NotAllowed(
            f"{mine.user} may not {what}, as a {mine.role}; create keys that may with "
            f"imud keys add DIR {access.who_may(do)[0]} NAME"
        )

    def listen(
        self,
        topic: str,
        probe: str | None,
        callback: Callable[[Delivery], None],
        *,
        history: int = 0,
    ) -> Callable[[], None]:
        """Calls back for each payload of a topic, in a thread of Zenoh's, until the
        returned function is called. probe None: all probes. The last `history` payloads
        of each probe come first, as far as the daemon kept them.

        An id is followed under every name; a name, whichever probe has it.
        """
        self.check_may(topic)

        def on_sample(sample: zenoh.Sample) -> None:
            name, probe_id = str(sample.key_expr).split("/")[-2], ""
            if sample.attachment is not None:
                probe_id, _, name = sample.attachment.to_string().partition(" ")
            stamp = sample.timestamp
            source = str(stamp.get_id()) if stamp is not None else ""
            callback(Delivery(name, sample.payload.to_bytes(), source, probe_id))

        key = self._key(probe, topic)
        if history > 0:
            kept = zenoh.ext.HistoryConfig(max_samples=history)
            return zenoh.ext.declare_advanced_subscriber(
                self._session, key, on_sample, history=kept
            ).undeclare
        return self._session.declare_subscriber(key, on_sample).undeclare

    def _key(self, probe: str | None, end: str) -> str:
        """The key of a probe by its name or id; None: of every probe. A body has a
        name, too.
        """
        if end == access.BODIES:
            return f"{self._prefix}/{end}/{access.address(probe)}/{access.BODY_STATE}"
        return f"{self._prefix}/{access.address(probe)}/{end}"

    def subscribe(
        self, topic: str, probe: str | None, callback: Callable[[str, bytes], None]
    ) -> Callable[[], None]:
        """listen() for a callback that takes only the probe's name and the payload."""
        return self.listen(
            topic, probe, lambda delivery: callback(delivery.probe, delivery.payload)
        )

    def statuses(self, probe: str | None = None) -> list[dict[str, Any]]:
        """The last status of each probe, sorted by name: docs/pose.md."""
        replies = self._session.get(self._key(probe, "status"), timeout=QUERY_TIMEOUT_S)
        found = [json.loads(r.ok.payload.to_bytes()) for r in replies if r.ok]
        return sorted(found, key=lambda status: str(status["probe"]))

    def alive(self) -> list[str]:
        """The names of the probes that are connected."""
        for pause_s in ALIVE_PAUSES_S:
            time.sleep(pause_s)
            names = self._alive_now(None)
            if names:
                return names
        return []

    def _alive_now(
        self, probe: str | None, timeout_s: float = QUERY_TIMEOUT_S
    ) -> list[str]:
        """The answer to one query, sorted."""
        key = self._key(probe, "alive")
        replies = self._session.liveliness().get(key, timeout=timeout_s)
        return sorted(str(r.ok.key_expr).split("/")[-2] for r in replies if r.ok)

    def wait_for(self, probe: str | None = None, *, seconds: float = 10.0) -> str:
        """The name of the first probe that is connected (or of `probe`), once it is.

        ProbeUnknown if none is within `seconds`.
        """
        arrived: queue.SimpleQueue[str] = queue.SimpleQueue()

        def on_token(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT:
                arrived.put(str(sample.key_expr).split("/")[-2])

        key = self._key(probe, "alive")
        watch = self._session.liveliness().declare_subscriber(
            key, on_token, history=True
        )
        until = time.monotonic() + seconds
        try:
            while (left := until - time.monotonic()) > 0:
                try:
                    return arrived.get(timeout=min(left, ALIVE_AGAIN_S))
                except queue.Empty:
                    if names := self._alive_now(probe, left):
                        return names[0]
        finally:
            watch.undeclare()
        raise ProbeUnknown(
            f"no probe{f' {probe}' if probe else ''} found within {seconds:g} s; "
            "plug it in, or see the output of imud run"
        )

    def only_probe(self, probe: str | None = None) -> str:
        """Checks that `probe` is connected; without a name, returns the only one.

        ProbeUnknown if it is not, or if there is none or more than one.
        """
        alive = self.alive()
        if probe is not None:
            if probe not in alive and not self._alive_now(probe):
                raise ProbeUnknown(f"no probe {probe}; {_choice(alive)}")
            return probe
        if len(alive) != 1:
            raise ProbeUnknown(
                "no probe is connected; plug one in, or see the output of imud run"
                if not alive
                else f"there are {len(alive)} probes; {_choice(alive)}"
            )
        return alive[0]

    def check_known(self, probe: str | None) -> None:
        """Whether that probe, if one is named, is there or was: ProbeUnknown if there
        are others alone. Without any, it may still come.
        """
        if probe is None:
            return
        statuses = self.statuses()
        known = {*self.alive(), *(str(each["probe"]) for each in statuses)}
        ids = {each.get("probe_id") for each in statuses}
        if known and probe not in known | ids:
            raise ProbeUnknown(f"no probe {probe}; {_choice(sorted(known))}")

    def command(self, probe: str, name: str, **arguments: str) -> dict[str, Any]:
        """Sends a command to a probe and returns the daemon's answer.

        CommandRefused with the reason, NoReply, or NotAllowed for a role that may not.
        """
        return self._command(probe, name, arguments, COMMAND_TIMEOUT_S)

    def _command(
        self, probe: str, name: str, arguments: dict[str, str], timeout_s: float
    ) -> dict[str, Any]:
        self.check_may(access.CMD + name)
        answer = self._query(self._key(probe, access.CMD + name), arguments, timeout_s)
        if answer is None:
            self.check_known(probe)
            raise NoReply(
                f"no reply to {name} for probe {probe}: it has disconnected (see imud "
                "list), or your keys no longer allow commands"
            )
        return answer

    def params(self, probe: str) -> dict[str, Any]:
        """The params of a probe: docs/params.md. ProbeUnknown if they are not known."""
        self.check_may("params")
        answer = self._query(self._key(probe, "params"), {}, QUERY_TIMEOUT_S)
        if answer is None:
            self.check_known(probe)
            raise ProbeUnknown(
                f"the params of probe {probe} are unknown; imud list shows the probes"
            )
        return answer

    def params_history(self, probe: str, digest: str | None = None) -> dict[str, Any]:
        """The sets that came into force at a probe, or the one whose digest begins so:
        docs/params.md. CommandRefused with the reason if there is none.
        """
        self.check_may("params")
        asked = {"digest": digest} if digest is not None else {"history": "1"}
        answer = self._query(self._key(probe, "params"), asked, QUERY_TIMEOUT_S)
        if answer is None:
            self.check_known(probe)
            raise ProbeUnknown(f"no probe {probe}; imud list shows the probes")
        value: dict[str, Any] = answer["value"]
        return value

    def change_params(
        self, probe: str, records: bytes, probe_id: str = "", *, is_forced: bool = False
    ) -> dict[str, Any]:
        """Puts these records in force, all or none, and returns the daemon's answer.
        `probe_id`: of the probe that they were made for; another one refuses them,
        unless it `is_forced`. CommandRefused with the reason if they are not taken.
        """
        arguments = {"records": records.hex()}
        if probe_id:
            arguments["probe"] = probe_id
        if is_forced:
            arguments["force"] = "1"
        return self._command(probe, "params", arguments, PARAMS_TIMEOUT_S)

    def _query(
        self, key: str, parameters: dict[str, str], timeout_s: float
    ) -> dict[str, Any] | None:
        """The answer to a query; None if there is none, CommandRefused if it is why."""
        selector = key
        if parameters:
            selector += "?" + ";".join(f"{k}={v}" for k, v in parameters.items())
        for reply in self._session.get(selector, timeout=timeout_s):
            if reply.ok:
                answer: dict[str, Any] = json.loads(reply.ok.payload.to_bytes())
                return answer
            if reply.err:
                raise CommandRefused(reply.err.payload.to_string())
        return None


def _choice(names: list[str]) -> str:
    return f"choose one: {', '.join(names)}" if names else "plug it in"
