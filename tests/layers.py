#!/usr/bin/env python3
"""Fails if an include climbs: a folder may include itself and what ALLOWED names for it. Fails if folders include each other in a
circle, if client and server both define a type of one name, if they read the time themselves, if an exposure takes a power or
logarithm of the C library, or if fewer than two files need a header."""
import pathlib
import re
import sys

# Each may include what stands above it. Siblings may not include each other.
SERVER = [["server/base"], ["server/encode"], ["server/vulkan"], ["server/render/color"], ["server/render/settings"],
          ["server/render/plan"], ["server/render/frame"],
          ["server/render/device", "server/render/host", "server/render/reference"],
          ["server/render/environment"], ["server/render"], ["server/schedule"], ["server/session"], ["server/access"],
          ["server/rpc"], ["server"], ["server/daemon"]]
ALLOWED = {"server/base": [], "proto": ["server/base"], "shaders": [], "client/base": [],
           "client/image": ["client/base", "server/encode", "proto"],
           "client/color": ["shaders", "proto", "server/render/color"],
           "client/environment": ["client/base", "client/image", "proto"], "client": ["client/base", "client/image", "proto"],
           "client/run": ["client", "client/base", "client/image", "client/color", "client/environment", "proto", "server/encode"]}
ALLOWED["client/cli"] = ["client/run"] + ALLOWED["client/run"]
for folder in [folder for folder in ALLOWED if folder.startswith("client")]:
    ALLOWED[folder].append("server/base")
above = list(SERVER[0])
for storey in SERVER[1:]:
    for folder in storey:
        ALLOWED[folder] = ["proto", "shaders"] + above
    above += storey
# The one door from the client into the server, and the exposures that both compute.
DOORS = {"client/run/embedded_server.cc": ["server", "server/base"],
         "client/run/exposure_file.cc": ["server/render/color"]}

# What reads the machine's time or waits by it. Server and client library take a Clock instead (server/base/clock.h), except for:
TIME = re.compile(r"\babsl::Now\(|_clock::now\(|\bSleepFor\(|\bthis_thread::sleep_|\b\w*[a-z]With(?:Timeout|Deadline)\("
                  r"|\b(?:Steady|Clock)::now\(|\bclock_gettime\(|\bgettimeofday\(|\btime\(nullptr\)|\bgrpc::Alarm\b")
READS_TIME = {"server/base/clock.cc",
              "client/retry.cc", "client/call/duplex_call.h", "client/call/duplex_call.cc",  # the user's notification; gRPC's queue
              "server/alarm_timers.cc", "server/server.cc",  # gRPC takes dates of its own clock
              "server/base/log.cc", "server/rpc/grpc_log.cc",  # the log
              "server/base/metrics.cc",  # when the process started
              "server/daemon/main.cc",  # a signal is waited for by the kernel
              # Work that is measured, or cut where its slice ends. Its slices have to be of real time.
              "server/base/crew.cc", "server/render/device/submissions.cc", "server/render/environment/environment_baker.cc",
              "server/render/plan/frame_stats.cc", "server/render/reference/reference_frame.cc"}
KEEPS_TIME = ("server/", "client/call/", "client/retry", "client/session")

# Exposures, metering's weights and tokens have the same bits on every machine. Powers and logarithms of C libraries have not.
POWER = re.compile(r"(?<![\w.>])(?:exp2?|exp10|expm1|log(?:2|10|1p)?|pow)[fl]?\(")
OWN_POWERS = ("server/render/plan/", "server/session/", "client/run/exposure_file.cc")

root = pathlib.Path(__file__).resolve().parent.parent


def layer(path: str) -> str:
    """The longest known folder that holds this file."""
    return max((folder for folder in ALLOWED if path.startswith(folder + "/")), key=len, default="")


climbs = []
hasty = []  # what reads the time itself
strange = []  # what takes a power of the C library
timed = set()  # what may, and does
sees = {}  # the folders that each folder includes
for top in ("proto", "shaders", "server", "client"):
    for source in sorted((root / top).rglob("*")):
        if source.suffix not in (".h", ".cc"):
            continue
        name = source.relative_to(root).as_posix()
        own = layer(name)
        allowed = [own] + ALLOWED[own] + DOORS.get(name, [])
        for line, text in enumerate(source.read_text().splitlines(), 1):
            if text.startswith("#include <CLI/") and own.startswith("client") and own != "client/cli":
                climbs.append(f"{name}:{line} includes CLI11, which {own} may not")
            if name.startswith(KEEPS_TIME) and (read := TIME.search(text.split("//")[0])):
                timed.add(name)
                if name not in READS_TIME:
                    hasty.append(f"{name}:{line} has {read[0]}...); take a Clock (server/base/clock.h)")
            if name.startswith(OWN_POWERS) and (power := POWER.search(text.split("//")[0])):
                strange.append(f"{name}:{line} has {power[0]}...); take it of server/render/color/portable_math.h")
            found = re.match(r'#include "((?:proto|shaders|server|client)/[^"]+)"', text)
            if not found or found[1].endswith(".spv.h"):
                continue
            sees.setdefault(pathlib.PurePath(name).parent, set()).add(pathlib.PurePath(found[1]).parent)
            if layer(found[1]) not in allowed:
                climbs.append(f"{name}:{line} includes {found[1]}, which {own} may not")


def circle(path: list) -> list:
    """The folders of a circle that goes on from `path`. A folder and those below it are one room, which may see itself."""
    for seen in sorted(sees.get(path[-1], ())):
        if seen in path[:-1]:
            return path[path.index(seen):]
        if seen.is_relative_to(path[-1]) or path[-1].is_relative_to(seen) or seen in finished:
            continue
        if found := circle(path + [seen]):
            return found
    finished.add(path[-1])
    return []


finished = set()
circles = list(dict.fromkeys("a circle of includes: " + " -> ".join(str(folder) for folder in found + found[:1])
                             for start in sorted(sees)
                             if start not in finished and (found := circle([start])) and found[0] == min(found)))

# The command links both sides, so a type of one name on both would be two definitions of one type.
TYPE = re.compile(r"^(?:class|struct|enum class) (\w+)[^;{]*\{", re.MULTILINE)
homes = {}
for side in ("client", "server"):
    for header in sorted((root / side).rglob("*.h")):
        for name in TYPE.findall(header.read_text()):
            homes.setdefault(name, {}).setdefault(side, header.relative_to(root).as_posix())
twice = [f"{places['server']} defines {name}, as {places['client']} does; rename one"
         for name, places in homes.items() if len(places) == 2]

# The list must not outgrow what it is for.
hasty += [f"{name} reads no time any more; take it off READS_TIME" for name in sorted(READS_TIME - timed)]

# What only one file needs lives in it.
needs = {}
for top in ("proto", "shaders", "server", "client", "tests"):
    for source in (root / top).rglob("*"):
        if source.suffix in (".h", ".cc"):
            for name in re.findall(r'^#include "([^"]+)"', source.read_text(), re.MULTILINE):
                needs.setdefault(name, set()).add(source)
lonely = [f"{name} is needed by {len(needs.get(name, ()))} file; put it there"
          for top in ("proto", "shaders", "server", "client", "tests")
          for name in sorted(header.relative_to(root).as_posix() for header in (root / top).rglob("*.h"))
          if len(needs.get(name, ())) < 2]

faults = climbs + circles + twice + hasty + strange + lonely
print("\n".join(faults) or "no include climbs, no clock is read but what is given, exposures take Candela's own powers, and every "
      "header has its users")
sys.exit(bool(faults))
