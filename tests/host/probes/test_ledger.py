# SPDX-License-Identifier: MIT
"""The account of a probe adds up, whatever happens to its messages on the way."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from fakes import FakeProbe
from imud.probes.boot import NUMBERS_KEPT, DecodedFrame, difference_32
from imud.probes.ledger import Account, FrameVerdict, Judged, totals
from imud.wire.messages import decode


def decoded(content: bytes, t_ns: int | None = None) -> DecodedFrame:
    message = decode(content)
    assert message.sequence is not None
    assert message.time_us is not None
    return DecodedFrame(content, message, message.sequence, message.time_us, t_ns)


def note(account: Account, *contents: bytes) -> list[Judged]:
    return [j for content in contents for j in account.note(decoded(content))]


def good_ones(account: Account, content: bytes) -> list[bytes]:
    judged = note(account, content)
    return [j.frame.content for j in judged if j.verdict is FrameVerdict.GOOD]


def verdicts(account: Account, *contents: bytes) -> list[str]:
    return [judged.verdict.value for judged in note(account, *contents)]


def skewed(content: bytes) -> bytes:
    """The same message with its last field missing."""
    return content[:-3]


def check(account: Account) -> dict[str, Any]:
    counts: Any = account.counts()
    for part in (counts, counts["earlier_boots"]):
        skews = sum(part["skewed"].values())
        assert part["sent"] == part["received"] + skews + part["lost"]
        assert min(part["sent"], part["received"], part["lost"]) >= 0
        assert part["duplicated"] >= 0
    return dict(counts)


FATES = st.sampled_from(["keep"] * 6 + ["lose", "double", "skew", "delay"])


@given(st.lists(FATES, max_size=60))
def test_every_number_of_one_boot_is_accounted_for_exactly(fates: list[str]) -> None:
    probe, account = FakeProbe(), Account()
    note(account, probe.content("hello"))
    delayed: list[bytes] = []
    for fate in fates:
        content = probe.content("pose")
        if fate in ("keep", "double"):
            note(account, content)
        if fate == "double":
            note(account, content)
        if fate == "skew":
            note(account, skewed(content))
        if fate == "delay":
            delayed.append(content)
        elif delayed:
            note(account, delayed.pop())
    for content in [probe.content("pose"), *delayed]:
        note(account, content)
    counts = check(account)
    late = counts["skewed"].pop("late", 0)
    assert counts["sent"] == len(fates) + 2
    assert counts["lost"] == fates.count("lose")
    assert counts["duplicated"] == fates.count("double")
    assert counts["skewed"].pop("missing", 0) == fates.count("skew")
    # A delayed one that no other has overtaken is in order.
    assert late <= fates.count("delay")
    assert counts["received"] == len(fates) + 2 - late - fates.count(
        "lose"
    ) - fates.count("skew")
    assert counts["skewed"] == {}
    assert counts["strays"] == 0


@given(
    st.lists(
        st.tuples(st.lists(FATES, max_size=20), st.booleans()), min_size=1, max_size=5
    ),
    st.integers(0, 2**32 - 1),
)
def test_the_identity_holds_over_any_boots_with_or_without_their_hello(
    boots: list[tuple[list[str], bool]], first: int
) -> None:
    account, probe = Account(), FakeProbe()
    probe.sequence = first
    passed: list[bytes] = []
    for fates, is_hello_heard in boots:
        hello = probe.content("hello")
        if is_hello_heard:
            passed += good_ones(account, hello)
        delayed: list[bytes] = []
        for fate in fates:
            content = probe.content("pose")
            copies = {"lose": [], "delay": [], "double": [content, content]}
            if fate == "skew":
                content = skewed(content)
            for copy in copies.get(fate, [content]):
                passed += good_ones(account, copy)
            if fate == "delay":
                delayed.append(content)
        note(account, *delayed)
        check(account)
        probe.restart()
    account.close()
    counts = check(account)
    assert counts["boots"] <= len(boots)
    good = totals(counts).received
    assert good >= len(set(passed) - {c for c in passed if passed.count(c) > 1})


def test_each_boot_with_its_hello_is_exact() -> None:
    probe, account = FakeProbe(), Account()
    for _ in range(3):
        hello, *rest = [probe.content("hello")] + [
            probe.content("pose") for _ in range(10)
        ]
        judged = note(account, hello, *rest[:4], *rest[6:])
        assert judged[0].begins_boot
        assert {j.verdict for j in judged} == {FrameVerdict.GOOD}
        probe.restart()
    counts = check(account)
    assert (counts["boots"], counts["sent"], counts["lost"]) == (3, 11, 2)
    assert counts["earlier_boots"]["sent"] == 22
    assert counts["earlier_boots"]["lost"] == 4
    total = totals(counts)
    assert (total.sent, total.received, total.lost) == (33, 27, 6)


def test_totals_add_all_boots_and_take_what_is_not_there_for_0() -> None:
    earlier = {"sent": 5, "skewed": {"missing": 1}}
    counts = {"sent": 3, "skewed": {"missing": 2, "late": 1}, "earlier_boots": earlier}
    total = totals(counts)
    assert (total.sent, total.received, total.lost, total.duplicated) == (8, 0, 0, 0)
    assert total.skewed == {"missing": 3, "late": 1}
    assert totals({}).sent == 0


def test_a_hello_with_another_boot_count_begins_a_boot_whatever_its_number() -> None:
    probe, account = FakeProbe(), Account()
    note(account, probe.content("hello"), probe.content("pose"))
    probe.restart()
    probe.sequence = 500
    assert note(account, probe.content("hello"))[0].begins_boot
    assert check(account)["lost"] == 0


def test_a_hello_with_number_0_begins_a_boot_though_the_count_stayed() -> None:
    probe, account = FakeProbe(), Account()
    note(account, probe.content("hello"), *(probe.content("pose") for _ in range(9)))
    probe.sequence, probe.time_us = 0, 17
    assert note(account, probe.content("hello"))[0].begins_boot


def test_a_copy_of_a_hello_is_a_copy() -> None:
    probe, account = FakeProbe(), Account()
    hello = probe.content("hello")
    assert verdicts(account, hello, probe.content("pose"), hello) == [
        "good",
        "good",
        "duplicate",
    ]
    assert check(account)["boots"] == 1


def test_a_copy_from_before_a_restart_does_not_bring_the_old_boot_back() -> None:
    probe, account = FakeProbe(), Account()
    old = [probe.content("hello"), *(probe.content("pose") for _ in range(50))]
    note(account, *old)
    probe.restart()
    fresh = [probe.content("hello"), probe.content("pose")]
    assert verdicts(account, *fresh, old[50], old[30]) == [
        "good",
        "good",
        "duplicate",
        "duplicate",
    ]
    counts = check(account)
    assert (counts["sent"], counts["lost"], counts["duplicated"]) == (2, 0, 0)
    assert counts["earlier_boots"]["duplicated"] == 2


def test_a_restart_whose_hello_is_lost_is_seen_by_two_messages() -> None:
    probe, account = FakeProbe(), Account()
    note(account, probe.content("hello"), *(probe.content("pose") for _ in range(99)))
    probe.restart()
    probe.content("hello")
    first, second = probe.content("event"), probe.content("pose")
    assert note(account, first) == []
    judged = note(account, second)
    assert [j.frame.content for j in judged] == [first, second]
    assert [j.begins_boot for j in judged] == [True, False]
    counts = check(account)
    assert (counts["sent"], counts["lost"], counts["boots"]) == (2, 0, 2)


def test_one_strange_message_is_a_stray_and_no_restart() -> None:
    probe, account = FakeProbe(), Account()
    note(account, probe.content("hello"), *(probe.content("pose") for _ in range(9)))
    strange = FakeProbe()
    strange.sequence, strange.time_us = 4, 77
    assert verdicts(account, strange.content("pose")) == []
    assert verdicts(account, probe.content("pose")) == ["stray", "good"]
    counts = check(account)
    assert (counts["boots"], counts["strays"], counts["lost"]) == (1, 1, 0)


def test_a_late_message_is_counted_and_not_passed_on() -> None:
    probe, account = FakeProbe(), Account()
    note(account, probe.content("hello"))
    early, late = probe.content("pose"), probe.content("pose")
    after = probe.content("pose")
    assert verdicts(account, early, after, late) == ["good", "good", "skewed"]
    counts = check(account)
    assert counts["skewed"] == {"late": 1}
    assert counts["lost"] == 0


def test_a_message_older_than_any_buffer_is_no_copy() -> None:
    probe, account = FakeProbe(), Account()
    contents = [probe.content("hello")]
    contents += [probe.content("pose") for _ in range(NUMBERS_KEPT + 1)]
    note(account, *contents)
    assert verdicts(account, contents[2]) == ["duplicate"]
    assert verdicts(account, contents[1]) == []
    assert [j.verdict for j in account.close()] == [FrameVerdict.STRAY]
    check(account)


def test_a_skewed_message_is_not_believed_about_a_number_far_ahead() -> None:
    probe, account = FakeProbe(), Account()
    note(account, probe.content("hello"))
    probe.sequence += NUMBERS_KEPT + 1
    assert verdicts(account, skewed(probe.content("pose"))) == ["skewed"]
    counts = check(account)
    assert counts["sent"] == 1
    assert counts["unplaced"] == {"missing": 1}


def test_numbers_and_times_wrap() -> None:
    probe, account = FakeProbe(), Account()
    probe.sequence, probe.time_us = 2**32 - 3, 2**32 - 12_000
    note(account, probe.content("hello"), *(probe.content("pose") for _ in range(9)))
    counts = check(account)
    assert (counts["sent"], counts["received"], counts["boots"]) == (10, 10, 1)


def test_a_long_silence_is_no_restart() -> None:
    probe, account = FakeProbe(), Account()
    account.note(decoded(probe.content("hello"), 0))
    probe.sequence, probe.time_us = 9000, 2**31 + 99
    judged = account.note(decoded(probe.content("pose"), 3_000_000_000_000))
    assert [j.verdict for j in judged] == [FrameVerdict.GOOD]
    assert check(account)["lost"] == 8999


def test_a_restart_that_has_passed_the_old_number_is_seen_by_its_clock() -> None:
    probe, account = FakeProbe(), Account()
    note(account, probe.content("hello"), probe.content("pose"))
    probe.time_us = 100_000_000
    note(account, probe.content("pose"))
    probe.restart()
    probe.sequence = 50
    judged = note(account, probe.content("pose"), probe.content("pose"))
    assert [j.begins_boot for j in judged] == [True, False]


def test_the_probes_own_counters_are_kept_beside_ours() -> None:
    probe, account = FakeProbe(), Account()
    note(account, probe.content("hello"))
    note(account, probe.content("status", messages_sent=41, messages_dropped=3))
    counts = check(account)
    assert (counts["probe_sent"], counts["probe_dropped"]) == (41, 3)


@pytest.mark.parametrize(
    ("a", "b", "expected"),
    [
        (0, 0, 0),
        (0, 2**32 - 1, 1),
        (2**32 - 1, 0, -1),
        (2**31 - 1, 0, 2**31 - 1),
        (2**31, 0, -(2**31)),
    ],
)
def test_a_difference_of_wrapping_numbers(a: int, b: int, expected: int) -> None:
    assert difference_32(a, b) == expected
