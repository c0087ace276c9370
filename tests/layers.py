#!/usr/bin/env python3
"""Fails if an include climbs (a folder may include only itself and what stands above it here), or if client and server both
define a type of one name."""
import pathlib
import re
import sys

SERVER = ["server/base", "server/encode", "server/vulkan", "server/render/color", "server/render/settings", "server/render/plan",
          "server/render/device", "server/render/host", "server/render/environment", "server/render/reference", "server/render", "server/schedule", "server/session", "server/access",
          "server/rpc", "server", "server/daemon"]
ALLOWED = {"server/base": [], "proto": ["server/base"], "shaders": [], "client/base": [], "client/image": ["client/base", "server/encode", "proto", "shaders"], "client/color": ["shaders", "proto", "server/render/color"],
           "client/environment": ["client/base", "client/image", "proto"], "client": ["client/base", "client/image", "proto"],
           "client/cli": ["client", "client/base", "client/image", "client/color", "client/environment", "proto", "server/encode"]}
for folder in [folder for folder in ALLOWED if folder.startswith("client")]:
    ALLOWED[folder].append("server/base")
for depth, folder in enumerate(SERVER[1:], 1):
    ALLOWED[folder] = ["proto", "shaders"] + SERVER[:depth]
# The one door from the client into the server.
DOORS = {"client/cli/commands/embedded_server.cc": ["server", "server/base"]}

root = pathlib.Path(__file__).resolve().parent.parent


def layer(path: str) -> str:
    """The longest known folder that holds this file."""
    return max((folder for folder in ALLOWED if path.startswith(folder + "/")), key=len, default="")


climbs = []
for top in ("proto", "shaders", "server", "client"):
    for source in sorted((root / top).rglob("*")):
        if source.suffix not in (".h", ".cc"):
            continue
        name = source.relative_to(root).as_posix()
        own = layer(name)
        allowed = [own] + ALLOWED[own] + DOORS.get(name, [])
        for line, text in enumerate(source.read_text().splitlines(), 1):
            found = re.match(r'#include "((?:proto|shaders|server|client)/[^"]+)"', text)
            if found and not found[1].endswith(".spv.h") and layer(found[1]) not in allowed:
                climbs.append(f"{name}:{line} includes {found[1]}, which {own} may not")

# The command links both sides, so a type of one name on both would be two definitions of one type.
TYPE = re.compile(r"^(?:class|struct|enum class) (\w+)[^;{]*\{", re.MULTILINE)
homes = {}
for side in ("client", "server"):
    for header in sorted((root / side).rglob("*.h")):
        for name in TYPE.findall(header.read_text()):
            homes.setdefault(name, {}).setdefault(side, header.relative_to(root).as_posix())
twice = [f"{places['server']} defines {name}, as {places['client']} does; rename one"
         for name, places in homes.items() if len(places) == 2]

print("\n".join(climbs + twice) or "no include climbs")
sys.exit(bool(climbs or twice))
