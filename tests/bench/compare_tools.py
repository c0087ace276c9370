"""What compare.py measures: one function a tool, which runs it once and returns {row: milliseconds a frame}."""
import json
import os
import pathlib
import re
import subprocess
import time

WIDTH, HEIGHT = 1920, 1080
LARGE = "3840x2160"
HERE = pathlib.Path(__file__).parent

# Row: (does, does not).
CANDELA = {
    "bright/standard": ("meters, exposes, five levels of bloom, ACES fit, sRGB", ""),
    "tiles/standard": ("the same, with light in 1 % of the tiles", ""),
    "dim/standard": ("the same, with nothing bright", ""),
    "bright/draft": ("the same as the first, bloom from a quarter of the size", "keep within half a code"),
    "aces-1": ("the same as the first, full ACES 1.x output transform by table", ""),
}


class Failed(Exception):
    """Why a tool gave no time."""


def run(*command: str, **environment: str) -> str:
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=600, env={**os.environ, **environment})
    except OSError as error:
        raise Failed(str(error)) from error
    if done.returncode != 0:
        said = (done.stderr or done.stdout).strip().splitlines()
        raise Failed(f"{command[0]} ended with {done.returncode}: {said[-1] if said else 'and said nothing'}")
    return done.stdout


def seconds(*command: str, **environment: str) -> float:
    start = time.perf_counter()
    run(*command, **environment)
    return time.perf_counter() - start


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
        self.device = ""
        run(str(binaries / "bench_frame"), str(WIDTH), str(HEIGHT), self.frame)
        run(str(binaries / "bench_frame"), *LARGE.split("x"), self.large)

    def candela(self) -> dict[str, float]:
        """render_bench's medians; the memcpy is the median of those beside the rows."""
        out = self.scratch / "bench.json"
        run(str(self.binaries / "render_bench"), f"--benchmark_filter=^{WIDTH}x{HEIGHT}/({'|'.join(CANDELA)})/",
            f"--benchmark_out={out}", "--benchmark_out_format=json", VK_ICD_FILENAMES=lavapipe())
        measured = json.loads(out.read_text())
        self.device = measured["context"]["device"]
        rows = {re.sub(r"^\d+x\d+/|/min_time.*", "", row["name"]): row for row in measured["benchmarks"]}
        copies = sorted(row["memcpy"] for row in rows.values())
        return {"memcpy": copies[len(copies) // 2], **{name: rows[name]["call"] for name in CANDELA}}

    def ffmpeg(self, filters: str, frames: int, *options: str, **environment: str) -> float:
        """What `frames` more frames take, each: the file is read and the first one made in both runs."""
        def times(count: int) -> float:
            chain = f"loop=loop={count - 1}:size=1,setparams=color_primaries=bt709:color_trc=linear,{filters}"
            return seconds("ffmpeg", "-hide_banner", "-loglevel", "error", "-nostdin", *options, "-i", self.frame, "-vf",
                           chain, "-f", "null", "-", **environment)
        return 1e3 * (times(2 * frames) - times(frames)) / frames

    def libplacebo(self) -> dict[str, float]:
        return {"libplacebo": self.ffmpeg(
            "hwupload,libplacebo=tonemapping=bt.2390:color_trc=iec61966-2-1:format=rgba,hwdownload,format=rgba", 6,
            "-init_hw_device", "vulkan=device", "-filter_hw_device", "device", VK_ICD_FILENAMES=lavapipe(),
            NODEVICE_SELECT="1")}

    def zscale(self) -> dict[str, float]:
        return {"zscale": self.ffmpeg("tonemap=hable,zscale=transfer=iec61966-2-1:range=full,format=gbrp", 20)}

    def opencv(self) -> dict[str, float]:
        return {"opencv": float(run("/usr/bin/python3", str(HERE / "opencv_chain.py"), self.frame, "7"))}

    def candela_file(self, row: str, *options: str) -> dict[str, float]:
        return {row: 1e3 * seconds(str(self.binaries / "candela"), "render", self.large, str(self.scratch / f"{row}.png"),
                                   "--curve", "aces-1", "--quiet", *options, VK_ICD_FILENAMES=lavapipe())}

    def file_whole(self) -> dict[str, float]:
        return self.candela_file("file")

    def file_curve(self) -> dict[str, float]:
        return self.candela_file("file-curve", "--exposure", "0", "--bloom", "0")

    def oiiotool(self) -> dict[str, float]:
        return {"oiiotool": 1e3 * seconds(
            "oiiotool", "--colorconfig", str(HERE / "aces.ocio"), self.large, "--ociodisplay", "sRGB", "ACES", "-d", "uint8",
            "-o", str(self.scratch / "oiiotool.png"))}

    def same_picture(self) -> str:
        """How far oiiotool's picture is from the curve alone; not a failure, whatever it is."""
        said = subprocess.run(["oiiotool", str(self.scratch / "oiiotool.png"), str(self.scratch / "file-curve.png"), "--diff"],
                              capture_output=True, text=True, check=False).stdout
        found = re.search(r"Max error\s*=\s*([\d.e+-]+)", said)
        return f"{255 * float(found[1]):.0f}" if found else "unknown"
