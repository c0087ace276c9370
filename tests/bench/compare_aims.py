"""The aims that docs/lab-notes.md names for the host's passes, held against compare.py's measurements."""
import json
import pathlib
import statistics
from typing import NamedTuple

from compare_tools import Cost, Tools

BRIGHT = "host bright/standard"
COUNTED_PIXELS = 640 * 360  # of render_counted's frames

# The most time that the passes of these rows of render_bench may take, in times of a memcpy of the input.
MEMCPYS = {"bright/standard": 5, "dim/standard": 3.3, "tiles/standard": 4, "aces-1": 7, "agx": 7}
# How many times as long as Candela's bright frame these rows of compare.py take at least.
PEERS = {"zscale": 4, "opencv": 11, "libplacebo": 16}


class Aim(NamedTuple):
    what: str
    aim: str
    measured: str
    met: bool


def at_most(what: str, measured: float, limit: float, unit: str) -> Aim:
    return Aim(what, f"at most {limit:g} {unit}", f"{measured:.3g} {unit}", measured <= limit)


def spread_of_sizes(ns_a_pixel: dict[str, float]) -> Aim:
    least, most = min(ns_a_pixel.values()), max(ns_a_pixel.values())
    middle = (least + most) / 2
    sizes = list(ns_a_pixel)
    return Aim(f"bright, ns a pixel, {sizes[0]} to {sizes[-1]}", "within 15 % of the middle",
               f"{least:.2f} to {most:.2f}, within {100 * (most / middle - 1):.0f} %", most <= 1.15 * middle)


def instructions_a_pixel() -> float:
    recorded = json.loads((pathlib.Path(__file__).parent / "instructions.json").read_text())["instructions"]
    return sum(count for name, count in recorded.items() if name.startswith("host bright/")) / COUNTED_PIXELS


def aims(costs: dict[str, list[Cost]], tools: Tools) -> list[Aim]:
    rows = [at_most(f"{row}, passes of 1920x1080", statistics.median(tools.passes_x_memcpy[f"host {row}"]), limit, "memcpys")
            for row, limit in MEMCPYS.items()]
    for peer, least in PEERS.items():
        if peer in costs:
            ratio = statistics.median(theirs.ms / ours.ms for theirs, ours in zip(costs[peer], costs[BRIGHT]))
            rows.append(Aim(f"{peer}, over the bright frame", f"at least {least} x", f"{ratio:.1f} x", ratio >= least))
    if "bake" in costs:
        rows.append(at_most("candela environment", statistics.median(cost.ms for cost in costs["bake"]) / 1e3, 1, "s"))
    rows.append(spread_of_sizes(tools.ns_a_pixel()))
    rows.append(at_most("candelad listens, the driver's cache empty", tools.cold_start_s(), 0.6, "s"))
    rows.append(at_most("bright, instructions a pixel, as recorded", instructions_a_pixel(), 50, "instructions"))
    return rows
