#!/usr/bin/env python3
"""Measures Candela and other tools in turn on one machine; writes compare.md, compare.json and compare.svg.

compare.py FOLDER_OF_BINARIES OUT_FOLDER [ROUNDS [WAIT]]
compare.sh installs and builds what this needs. Each round starts when other work leaves the processors alone, or after
WAIT seconds (60). Ratios are those of the same round; a tool that cannot be run here is left out with its reason.
"""
import datetime
import json
import os
import pathlib
import platform
import resource
import statistics
import sys
import tempfile
import time

import compare_aims
import compare_output
from compare_tools import CANDELA, CUBE, HEIGHT, LARGE, PANORAMA, WIDTH, Cost, Failed, Tools, run

MEMORY = f"{WIDTH}x{HEIGHT}, memory to memory"
QUIET_CORES = 0.2
BAKES = f"{PANORAMA} panorama, OpenEXR to a cube map of {CUBE}, the whole command"
FILES = f"{LARGE}, OpenEXR (half, ZIP) to PNG, the whole command"

# Name, group, label, does, does not; Candela's first.
ROWS = [(name, MEMORY, *words) for name, words in CANDELA.items()] + [
    ("zscale", MEMORY, "ffmpeg tonemap=hable, zscale", "a tone curve, sRGB, 8 bits", "meter, expose, bloom"),
    ("opencv", MEMORY, "OpenCV (Python)", "exposes by the log average, five levels of bloom, Narkowicz's ACES curve, gamma 2.2",
     "keep a bound of error"),
    ("libplacebo", MEMORY, "ffmpeg libplacebo, on lavapipe",
     "decodes PQ (it tone maps no linear frame), peak detection over time, BT.2390, sRGB, dither", "expose by the average, bloom"),
    ("file", FILES, "candela render --curve aces-1", "meters, exposes, bloom, full ACES 1.x by table", ""),
    ("file-curve", FILES, "the same, exposure 1, no bloom", "full ACES 1.x by table", "expose, bloom"),
    ("oiiotool", FILES, "oiiotool --ociodisplay", "full ACES 1.x, computed for every pixel", "meter, expose, bloom"),
    ("bake", BAKES, "candela environment", "five GGX levels, harmonics, KTX2 of halves; adaptive, within 2 %", ""),
    ("cmgen", BAKES, "Filament's cmgen --deploy", "five GGX levels and harmonics, KTX of 10 and 11 bits; 1024 samples a texel",
     "say its error"),
    ("exrenvmap", BAKES, "OpenEXR's exrenvmap", "the cube map alone, as OpenEXR", "levels, harmonics"),
]


def busy_cpu_seconds() -> float:
    """The whole machine's processor time since its start, including the time that the hypervisor took."""
    user, nice, system, _, _, irq, softirq, steal = map(int, pathlib.Path("/proc/stat").read_text().split("\n")[0].split()[1:9])
    return (user + nice + system + irq + softirq + steal) / os.sysconf("SC_CLK_TCK")


def own_cpu_seconds() -> float:
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(u.ru_utime + u.ru_stime for u in used)


class OtherWork:
    """The number of cores that everything else has used since this object was made."""
    def __init__(self) -> None:
        self.begin, self.cpu = time.time(), busy_cpu_seconds() - own_cpu_seconds()

    def cores(self) -> float:
        return max(0.0, busy_cpu_seconds() - own_cpu_seconds() - self.cpu) / (time.time() - self.begin)


def wait_for_quiet(limit: float) -> None:
    deadline = time.time() + limit
    while time.time() < deadline:
        other = OtherWork()
        time.sleep(2)
        if other.cores() < QUIET_CORES:
            return


def processor() -> str:
    lines = pathlib.Path("/proc/cpuinfo").read_text().splitlines()
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return f"{len(os.sched_getaffinity(0))} cores of {names[0] if names else platform.machine()}"


def versions() -> dict[str, str]:
    packages = ("mesa-vulkan-drivers", "ffmpeg", "python3-opencv", "openimageio-tools", "libopencolorio2.1",
                "libfilament-tools", "openexr")
    said = run("dpkg-query", "-W", "-f", "${Package} ${Version}\\n", *packages)
    return dict(line.split(" ", 1) for line in said.splitlines())


def measure(tools: Tools, rounds: int, wait: float) -> tuple[dict[str, list[Cost]], dict[str, str], list[float]]:
    """Runs every tool once a round, Candela first. Returns each tool's times, or the reason why it failed, and the
    cores that other work used in each round. A tool that failed is not run again."""
    costs: dict[str, list[Cost]] = {}
    failed: dict[str, str] = {}
    others: list[float] = []
    asked = {"candela": tools.candela, "zscale": tools.zscale, "opencv": tools.opencv, "libplacebo": tools.libplacebo,
             "file": tools.file_whole, "file-curve": tools.file_curve, "oiiotool": tools.oiiotool,
             "bake": tools.bake, "cmgen": tools.cmgen, "exrenvmap": tools.exrenvmap}
    for i in range(rounds):
        wait_for_quiet(wait)
        print(f"round {i + 1} of {rounds}", file=sys.stderr)
        other = OtherWork()
        for name, tool in asked.items():
            if name in failed:
                continue
            try:
                for row, cost in tool().items():
                    costs.setdefault(row, []).append(cost)
            except Failed as error:
                failed[name] = str(error)
        others.append(other.cores())
    if "candela" in failed:
        raise SystemExit(f"Candela itself could not be measured: {failed['candela']}")
    return costs, failed, others


def spread(values: list[float]) -> dict[str, float]:
    return {"median": statistics.median(values), "min": min(values), "max": max(values)}


def summary(costs: list[Cost]) -> dict:
    times = [cost.ms for cost in costs]
    return {"ms": times, **spread(times), "cpu_ms": spread([cost.cpu_ms for cost in costs])}


def main() -> None:
    binaries, out = (pathlib.Path(path) for path in sys.argv[1:3])
    rounds = int(sys.argv[3]) if len(sys.argv) > 3 else 7
    wait = float(sys.argv[4]) if len(sys.argv) > 4 else 60
    out.mkdir(parents=True, exist_ok=True)
    load, begin = os.getloadavg()[0], time.time()
    with tempfile.TemporaryDirectory(prefix="candela-compare-") as scratch:
        tools = Tools(binaries, pathlib.Path(scratch))
        costs, failed, others = measure(tools, rounds, wait)
        codes = tools.codes_from_oiiotool()
        aims = [aim._asdict() for aim in compare_aims.aims(costs, tools)]
    rows = []
    for name, group, label, does, does_not in ROWS:
        ours = name in CANDELA or name.startswith("file") or name == "bake"
        row = {"name": name, "group": group, "label": label, "ours": ours, "does": does, "does_not": does_not}
        if name in costs:
            row |= summary(costs[name])
            if group == MEMORY:
                row["x_memcpy"] = spread([cost.ms / copy.ms for cost, copy in zip(costs[name], costs["memcpy"])])
        else:
            row["left_out"] = failed[name]
        rows.append(row)
    result = {"date": datetime.datetime.fromtimestamp(begin, datetime.timezone.utc).strftime("%Y-%m-%d"), "rounds": rounds,
              "seconds": round(time.time() - begin), "processor": processor(), "device": tools.device,
              "versions": versions(), "load_before": load, "cores_used_by_others": spread(others),
              "memcpy": summary(costs["memcpy"]), "codes_from_oiiotool": codes, "rows": rows,
              "aims": aims}
    (out / "compare.json").write_text(json.dumps(result, indent=1) + "\n")
    (out / "compare.md").write_text(compare_output.markdown(result))
    (out / "compare.svg").write_text(compare_output.svg(result))
    print(compare_output.markdown(result), end="")


if __name__ == "__main__":
    main()
