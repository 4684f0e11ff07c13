# SPDX-License-Identifier: MIT
"""The parts of results about the host that documents cite (benchmarks/kept.py)."""

from __future__ import annotations

from benchmarks.common.whole import Results, demand


def card_log(found: Results) -> Results:
    """Of firmware/card.py: counts of the wire and the card."""
    demand(found["seconds"] >= 600.0, f"{found['seconds']:g} s")
    return {name: value for name, value in found.items() if name != "complaints"}


def missed(run: Results) -> int:
    """Frames lost anywhere between the pty and the subscriber."""
    fell_out = run["poses_sent"] - run["poses_heard"]
    return int(fell_out + run["dropped"] + run["overrun"])


def daemon_load(found: Results) -> Results:
    """Of host/daemon.py: each number of probes, decoding, memory."""
    runs = {
        "relay" if run["is_relay"] else f"{run['probes']}": run
        | {"missed": missed(run)}
        for run in found["live"]
    }
    demand(len(runs) >= 6, f"{len(runs)} runs")
    shortest = min(run["seconds"] for run in runs.values())
    demand(shortest >= 20.0, f"{shortest:g} s")
    first, *_, last = found["memory"]
    return {
        "probes": runs,
        "line": found["line"],
        "frames_a_second": found["decoding"]["frames_a_second"],
        "memory": {"first": first, "last": last},
    }


def stages(found: Results) -> Results:
    """Of host/hot_path.py: each stage of a pose."""
    demand(found["runs"] >= 12 and found["turns"] >= 300, f"{found['runs']} runs")
    demand(not found["tared"], "--tared")
    return {"runs": found["runs"], "stages_us": found["stages_us"]}


def dating(found: Results) -> Results:
    """Of host/clocks.py: time and memory along the messages."""
    count = found["messages"]
    demand(count >= 1_000_000, f"{count} messages")
    times, sizes = found["microseconds"], found["bytes"]
    return {
        "messages": count,
        "microseconds": {"least": min(times), "most": max(times)},
        "bytes": {"first": sizes[0], "last": sizes[-1]},
        "outside": found["outside"],
    }


def soaked(found: Results) -> Results:
    """Of host/soak.py: each probe's counts beside the true ones, and their sums."""
    demand(found["ok"], "it does not add up")
    probes, points = found["probes"], found["memory"]
    demand(len(probes) >= 4, f"{len(probes)} probes")
    faults: dict[str, int] = {}
    for probe in probes:
        for name, count in probe["faults"].items():
            faults[name] = faults.get(name, 0) + count
    sums = ("sent", "corrupt", "wrong", "dated", "outside_bound")
    limits = {"rss_mib", "folder_mb"}
    return {
        "hours": found["hours"],
        "probes": probes,
        "sums": {name: sum(probe[name] for probe in probes) for name in sums},
        "faults": faults | {"all": sum(faults.values())},
        "log": found["log"],
        "least": {name: min(point[name] for point in points) for name in limits},
        "most": {name: max(point[name] for point in points) for name in limits},
    }


def soak(found: Results) -> Results:
    """Hours with a log whose files are read back."""
    demand(found["hours"] >= 3.0, f"{found['hours']:g} h")
    return soaked(found)


def soak_limited(found: Results) -> Results:
    """An hour with a log whose size is limited."""
    demand(found["hours"] >= 1.0 and found["keep_mb"] == 100, f"{found['hours']:g} h")
    return soaked(found)


def fleet(found: Results) -> Results:
    """Of host/hosts.py --log: each row, by its probes, rate and daemons."""
    rows = {
        "{probes} at {rate_hz}, {daemons}".format(**row["size"]): row
        for row in found["rows"]
    }
    demand(len(rows) >= 7 and found["has_log"], f"{len(rows)} rows")
    shortest = min(row["seconds"] for row in rows.values())
    demand(shortest >= 10.0, f"{shortest:g} s")
    return {"rows": rows}


def dated(found: Results) -> Results:
    """Of host/tested.py clock: each board and link."""
    demand(len(found) >= 4, f"{len(found)} boards and links")
    return found


def sites(found: Results) -> Results:
    """Of host/tested.py sites: each fault."""
    faults: Results
    (faults,) = found.values()
    demand(len(faults) >= 7, f"{len(faults)} figures")
    return faults


def attacks(found: list[Results]) -> Results:
    """Of host/attacks.py: the daemon alone and under attack."""
    alone, attacked = found
    demand(attacked["seconds"] >= 3600.0, f"{attacked['seconds']:g} s")
    return {"alone": alone, "attacked": attacked}


def page(found: Results) -> Results:
    """Of page/browser.py: views, memory, the cost of browsers."""
    demand(found["seconds"] >= 20.0, f"{found['seconds']:g} s")
    points = found["memory"]
    demand(points[-1]["minutes"] >= 60.0, f"{points[-1]['minutes']:g} minutes")
    costs = {f"{row['browsers']:.0f}": row for row in found["cost"]}
    demand(len(costs) >= 4, f"{len(costs)} numbers of browsers")
    return {
        "views": found["views"],
        "memory": {"first": points[0], "last": points[-1]},
        "browsers": costs,
    }
