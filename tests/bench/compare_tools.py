"""The tools that compare.py measures. One function for each tool runs it once and returns the times of its rows."""
import json
import math
import os
import pathlib
import re
import resource
import statistics
import subprocess
import time
from typing import NamedTuple

WIDTH, HEIGHT = 1920, 1080
LARGE = "3840x2160"
PANORAMA = "1024x512"
CUBE = 256
HERE = pathlib.Path(__file__).parent

# Row of render_bench: (label, does, does not).
FRAMES = {
    "bright/standard": ("Candela", "meters, exposes, five levels of bloom, ACES fit, sRGB", ""),
    "tiles/standard": ("Candela, 1 % of the tiles bright", "the same", ""),
    "dim/standard": ("Candela, nothing bright", "the same; there is no bloom to add", ""),
    "bright/draft": ("Candela, draft", "the same as the first, bloom from a quarter of the size",
                     "keep the bounds of error of standard"),
    "aces-1": ("Candela, full ACES 1.x", "the same as the first, the output transform by table", ""),
    "agx": ("Candela, AgX", "the same as the first, another curve", ""),
}
# Of the flatness of the time a pixel.
SIZES = ("1366x768", "1920x1080", "2560x1440", "3840x2160", "5120x2880", "7680x4320")
# Who makes the passes: what follows in the label. The rows are named "host bright/standard".
PASSES = {"host": "", "device": ", the device's passes"}
CANDELA = {f"{who} {name}": (label + words, *rest) for who, words in PASSES.items() for name, (label, *rest) in FRAMES.items()}


class Cost(NamedTuple):
    """The times of one frame."""
    ms: float
    cpu_ms: float  # of all threads; depends least on the machine's other load


class Failed(Exception):
    """The reason why a tool gave no time."""


def run(*command: str, **environment: str) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, env={**os.environ, **environment})
    except (OSError, subprocess.TimeoutExpired) as error:
        raise Failed(str(error)) from error
    if done.returncode != 0:
        said = (done.stderr or done.stdout).strip().splitlines()
        raise Failed(f"{command[0]} ended with {done.returncode}: {said[-1] if said else 'and said nothing'}")
    return done.stdout


def cost(*command: str, **environment: str) -> Cost:
    """The times of the whole process."""
    def cpu_seconds() -> float:
        used = resource.getrusage(resource.RUSAGE_CHILDREN)
        return used.ru_utime + used.ru_stime
    start, cpu = time.perf_counter(), cpu_seconds()
    run(*command, **environment)
    return Cost(1e3 * (time.perf_counter() - start), 1e3 * (cpu_seconds() - cpu))


def lavapipe() -> str:
    """The path of lavapipe's manifest, so that no other driver is taken."""
    for folder in ("/usr/share/vulkan/icd.d", "/etc/vulkan/icd.d"):
        for manifest in sorted(pathlib.Path(folder).glob("lvp_icd*.json")):
            return str(manifest)
    raise Failed("there is no lavapipe; install mesa-vulkan-drivers")


class Tools:
    def __init__(self, binaries: pathlib.Path, scratch: pathlib.Path) -> None:
        self.binaries, self.scratch = binaries, scratch
        self.frame, self.large = str(scratch / "frame.exr"), str(scratch / "large.exr")
        self.panorama = str(scratch / "panorama.exr")
        self.device = ""
        self.passes_x_memcpy: dict[str, list[float]] = {}
        run(str(binaries / "bench_frame"), str(WIDTH), str(HEIGHT), self.frame)
        run(str(binaries / "bench_frame"), *LARGE.split("x"), self.large)
        run(str(binaries / "candela"), "sample", "--size", PANORAMA, "--panorama", self.panorama, "--quiet")

    def render_bench(self, who: str, sizes: str, rows: str) -> dict[str, dict]:
        """The measurements of the rows with these passes, by SIZE/ROW. Both are regular expressions."""
        out = self.scratch / f"bench-{who}.json"
        run(str(self.binaries / "render_bench"), who, f"--benchmark_filter=^({sizes})/({rows})/",
            f"--benchmark_out={out}", "--benchmark_out_format=json", VK_ICD_FILENAMES=lavapipe())
        measured = json.loads(out.read_text())
        self.device = measured["context"]["device"]
        return {row["name"].partition("/min_time")[0]: row for row in measured["benchmarks"]}

    def candela(self) -> dict[str, Cost]:
        """render_bench's medians; the memcpy is the median of those beside the rows."""
        costs: dict[str, Cost] = {}
        copies: list[float] = []
        for who in PASSES:
            for name, row in self.render_bench(who, f"{WIDTH}x{HEIGHT}", "|".join(FRAMES)).items():
                key = f"{who} {name.partition('/')[2]}"
                costs[key] = Cost(row["call"], row["cpu"])
                copies.append(row["memcpy"])
                self.passes_x_memcpy.setdefault(key, []).append(row["x_memcpy"])
        copy = statistics.median(copies)
        return {"memcpy": Cost(copy, copy), **costs}

    def ns_a_pixel(self) -> dict[str, float]:
        """Of the host's passes for the bright frame, by size."""
        rows = self.render_bench("host", "|".join(SIZES), "bright/standard")
        return {size: 1e6 * rows[f"{size}/bright/standard"]["device"] / math.prod(map(int, size.split("x"))) for size in SIZES}

    def cold_start_s(self) -> float:
        """From candelad's start until it listens, with an empty cache; the median of five."""
        times = []
        for i in range(5):
            cache = self.scratch / f"cache-{i}"
            begin = time.perf_counter()
            with subprocess.Popen([str(self.binaries / "candelad"), "--listen", "127.0.0.1:0"],
                                  stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True,
                                  env=os.environ | {"VK_ICD_FILENAMES": lavapipe(), "MESA_SHADER_CACHE_DIR": str(cache)}) as server:
                if not any("listening" in line for line in server.stdout):
                    raise Failed("candelad did not say that it listens")
                times.append(time.perf_counter() - begin)
                server.terminate()
        return statistics.median(times)

    def ffmpeg(self, once: str, filters: str, frames: int, *options: str, **environment: str) -> Cost:
        """The time of one frame, from two runs that differ by `frames` frames. Both read the file and do `once` one time."""
        def whole(count: int) -> Cost:
            linear = "setparams=color_primaries=bt709:color_trc=linear:colorspace=gbr"
            chain = f"{linear},{once}loop=loop={count - 1}:size=1,{filters}"
            return cost("ffmpeg", "-hide_banner", "-loglevel", "error", "-nostdin", *options, "-i", self.frame, "-vf", chain,
                        "-f", "null", "-", **environment)
        few, many = whole(frames), whole(2 * frames)
        return Cost((many.ms - few.ms) / frames, (many.cpu_ms - few.cpu_ms) / frames)

    def libplacebo(self) -> dict[str, Cost]:
        """The frame in PQ, because the tool takes linear light for a display's and does not tone map it."""
        return {"libplacebo": self.ffmpeg(
            "zscale=transfer=smpte2084:npl=100,format=gbrp16le,",
            "hwupload,libplacebo=tonemapping=bt.2390:color_trc=iec61966-2-1:format=rgba,hwdownload,format=rgba", 6,
            "-init_hw_device", "vulkan=device", "-filter_hw_device", "device", VK_ICD_FILENAMES=lavapipe(),
            NODEVICE_SELECT="1")}

    def zscale(self) -> dict[str, Cost]:
        return {"zscale": self.ffmpeg("", "tonemap=hable,zscale=transfer=iec61966-2-1:range=full,format=gbrp", 20)}

    def opencv(self) -> dict[str, Cost]:
        return {"opencv": Cost(*map(float, run("/usr/bin/python3", str(HERE / "opencv_chain.py"), self.frame, "7").split()))}

    def candela_file(self, row: str, *options: str) -> dict[str, Cost]:
        return {row: cost(str(self.binaries / "candela"), "render", self.large, str(self.scratch / f"{row}.png"),
                          "--curve", "aces-1", "--quiet", *options, VK_ICD_FILENAMES=lavapipe())}

    def file_whole(self) -> dict[str, Cost]:
        return self.candela_file("file")

    def file_curve(self) -> dict[str, Cost]:
        return self.candela_file("file-curve", "--exposure", "0", "--bloom-intensity", "0")

    def oiiotool(self) -> dict[str, Cost]:
        return {"oiiotool": cost(
            "oiiotool", "--colorconfig", str(HERE / "aces.ocio"), self.large, "--ociodisplay", "sRGB", "ACES", "-d", "uint8",
            "-o", str(self.scratch / "oiiotool.png"))}

    def bake(self) -> dict[str, Cost]:
        return {"bake": cost(str(self.binaries / "candela"), "environment", self.panorama, str(self.scratch / "cube.ktx2"),
                             "--size", str(CUBE), "--sh", str(self.scratch / "cube.json"), "--quiet",
                             VK_ICD_FILENAMES=lavapipe())}

    def cmgen(self) -> dict[str, Cost]:
        return {"cmgen": cost("cmgen", "--quiet", f"--deploy={self.scratch / 'cmgen'}", "--format=ktx", f"--size={CUBE}",
                              self.panorama)}

    def exrenvmap(self) -> dict[str, Cost]:
        return {"exrenvmap": cost("exrenvmap", "-c", "-w", str(CUBE), self.panorama, str(self.scratch / "cube.exr"))}

    def codes_from_oiiotool(self) -> dict[str, float]:
        """The difference between its picture and Candela's curve alone, in 8-bit codes; {} if either is missing."""
        said = subprocess.run(["oiiotool", str(self.scratch / "oiiotool.png"), str(self.scratch / "file-curve.png"), "--diff"],
                              capture_output=True, text=True, check=False).stdout
        return {word.lower(): 255 * float(value) for word, value in re.findall(r"(Mean|Max) error\s*=\s*([\d.e+-]+)", said)}
