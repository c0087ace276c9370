#!/usr/bin/env python3
"""Measures whole commands from files to files beside ffmpeg and oiiotool: compare_files.py FOLDER_OF_BINARIES [ROUNDS]

Makes its own frames, runs everything in turn each round, and prints a table: the median of the processor times, children
included, the median of the ratios within a round, and the aim. compare.sh installs and builds what this needs.
"""
import os
import pathlib
import statistics
import subprocess
import sys
import tempfile
from typing import Callable, NamedTuple

import numpy

from compare_tools import HERE, Cost, Failed, cost, lavapipe, run

WIDTH, HEIGHT, FRAMES, SHOT = 1920, 1080, 24, 48
PEERS_SHOT = 6  # oiiotool needs seconds for a frame
QUIET = ("ffmpeg", "-hide_banner", "-loglevel", "error", "-nostdin", "-y")
DISPLAY = ("--colorconfig", str(HERE / "aces.ocio"))
SHOWN = ("--ociodisplay", "sRGB", "ACES", "-d", "uint8")


class Row(NamedTuple):
    what: str
    ours: str
    peer: str  # "": the aim is a time
    aim: float  # the peer's time over ours at least; without a peer at most these ms
    unit: int = 1  # what the times are divided by
    wall: bool = False


ROWS = [Row("24 frames to JPEG, a frame; ffmpeg only decodes", "jpg", "decode", 1.15, FRAMES),
        Row("the same to PNG; ffmpeg only decodes", "png", "decode", 0.92, FRAMES),
        Row("the same to PNG; ffmpeg writes it, too, and maps no tones", "png", "ffmpeg-png", 5, FRAMES),
        Row("the same to PNG of 16 bits; ffmpeg only decodes", "png16", "decode", 0.66, FRAMES),
        Row("4K to PNG; oiiotool with ACES", "4k", "oiio-4k", 11),
        Row("600x400 to PNG, wall time", "small", "", 50, wall=True),
        Row("600x400 to PNG; oiiotool with ACES", "small", "oiio-small", 1),
        Row("4K to a JPEG of 480 pixels; oiiotool --resize with ACES", "480", "oiio-480", 13),
        Row("a frame of a shot of 48 to h264, without the encoder; oiiotool with ACES and ffmpeg", "film", "oiio-film", 5)]


def make_frames(folder: pathlib.Path) -> None:
    """Gradients, lamps and noise of a few percent, in half floats with ZIP, as of a path tracer: 6 to 7 MB a frame."""
    random = numpy.random.default_rng(42)
    y, x = numpy.mgrid[0:HEIGHT, 0:WIDTH].astype(numpy.float32)

    def write(picture: numpy.ndarray, name: str) -> None:
        pfm = folder / "frame.pfm"
        head = f"PF\n{picture.shape[1]} {picture.shape[0]}\n-1\n".encode()
        pfm.write_bytes(head + numpy.ascontiguousarray(picture[::-1], numpy.float32).tobytes())
        run("oiiotool", str(pfm), "-d", "half", "--compression", "zip", "-o", str(folder / name))

    def frame(number: int) -> numpy.ndarray:
        light = 0.05 + 0.4 * x / WIDTH + 0.2 * numpy.sin(0.004 * (y + 9 * number)) ** 2
        lamps = 30 * numpy.exp(-(((x - 300 - 20 * number) / 40) ** 2 + ((y - 400) / 40) ** 2))
        picture = numpy.stack([light + lamps, 0.8 * light + 0.9 * lamps, 0.6 * light + 0.6 * lamps], axis=-1)
        return picture * (1 + 0.03 * random.standard_normal(picture.shape, numpy.float32))

    (folder / "seq").mkdir()
    (folder / "shot").mkdir()
    frames = [frame(number) for number in range(4)]
    write(numpy.concatenate([numpy.concatenate(frames[:2], 1), numpy.concatenate(frames[2:], 1)]), "4k.exr")
    write(frames[0][300:700, 100:700], "small.exr")
    for number in range(SHOT):
        if number < FRAMES:
            write(frame(number), f"seq/{number + 1:04d}.exr")
        (folder / f"shot/{number + 1:04d}.exr").symlink_to(f"../seq/{number % FRAMES + 1:04d}.exr")
    for name in ("out", "peer"):
        (folder / name).mkdir()


def tools(candela: str, sizes: bool) -> dict[str, Callable[[], Cost]]:
    """What runs, by the names in ROWS. In the folder of the frames."""
    def ours(*words: str) -> Cost:
        return cost(candela, *words, "--quiet", VK_ICD_FILENAMES=lavapipe())

    def stream(out: str, *options: str) -> Cost:
        return ours("stream", "seq/####.exr", f"out/{out}", "--fps", "24", *options)

    def encode(*source: str) -> Cost:
        return cost(*QUIET, *source, "-c:v", "libx264", "-preset", "medium", "-crf", "18", "-pix_fmt", "yuv420p", "peer/film.mp4")

    def encoder_alone(frames: int) -> Cost:
        """From a y4m, which is next to nothing to read."""
        y4m = pathlib.Path(f"peer/{frames}.y4m")
        if not y4m.exists():
            with y4m.open("wb") as out:
                subprocess.run([candela, "stream", "shot/####.exr", "-", "--range", f"1-{frames}", "--fps", "24", "--quiet"],
                               stdout=out, check=True, env=os.environ | {"VK_ICD_FILENAMES": lavapipe()})
        return encode("-i", str(y4m))

    def of_a_frame(frames: int, *parts: Cost) -> Cost:
        """The sum of these parts without the encoder, in which ours and the peer's are the same."""
        encoder = encoder_alone(frames)
        return Cost(*((sum(part) - less) / frames for *part, less in zip(*parts, encoder)))

    def oiio_film() -> Cost:
        shown = cost("oiiotool", *DISPLAY, "--frames", f"1-{PEERS_SHOT}", "shot/%04d.exr", *SHOWN, "-o", "peer/%04d.png")
        return of_a_frame(PEERS_SHOT, shown, encode("-r", "24", "-start_number", "1", "-i", "peer/%04d.png"))

    def thumbnail() -> Cost:
        if not sizes:
            raise Failed("this candela has no --max-size")
        return ours("render", "4k.exr", "out/480.jpg", "--max-size", "480")

    return {"jpg": lambda: stream("%04d.jpg"), "png": lambda: stream("%04d.png"), "png16": lambda: stream("%04d.png", "--bits", "16"),
            "decode": lambda: cost(*QUIET, "-i", "seq/%04d.exr", "-f", "null", "-"),
            "ffmpeg-png": lambda: cost(*QUIET, "-i", "seq/%04d.exr", "-pix_fmt", "rgb24", "peer/ffmpeg-%04d.png"),
            "4k": lambda: ours("render", "4k.exr", "out/4k.png"),
            "oiio-4k": lambda: cost("oiiotool", *DISPLAY, "4k.exr", *SHOWN, "-o", "peer/4k.png"),
            "small": lambda: ours("render", "small.exr", "out/small.png"),
            "oiio-small": lambda: cost("oiiotool", *DISPLAY, "small.exr", *SHOWN, "-o", "peer/small.png"),
            "480": thumbnail,
            "oiio-480": lambda: cost("oiiotool", *DISPLAY, "4k.exr", "--resize", "480x270", *SHOWN, "-o", "peer/480.jpg"),
            "film": lambda: of_a_frame(SHOT, ours("stream", "shot/####.exr", "out/film.mp4", "--fps", "24")),
            "oiio-film": oiio_film}


def measure(asked: dict[str, Callable[[], Cost]], rounds: int) -> tuple[dict[str, list[Cost]], dict[str, str]]:
    costs: dict[str, list[Cost]] = {name: [] for name in asked}
    failed: dict[str, str] = {}
    for i in range(rounds):
        print(f"round {i + 1} of {rounds}", file=sys.stderr)
        for name, tool in asked.items():
            try:
                if name not in failed:
                    costs[name].append(tool())
            except Failed as error:
                failed[name] = str(error)
    return costs, failed


def line(row: Row, costs: dict[str, list[Cost]], failed: dict[str, str]) -> str:
    why = [failed[name] for name in (row.ours, row.peer) if name in failed]
    if why:
        return f"| {row.what} | left out: {why[0]} | | | | |"

    def times(name: str) -> list[float]:
        return [(one.ms if row.wall else one.cpu_ms) / row.unit for one in costs[name]]
    ours = times(row.ours)
    if not row.peer:
        middle = statistics.median(ours)
        return f"| {row.what} | {middle:.1f} | | | {row.aim:g} ms | {'met' if middle <= row.aim else 'missed'} |"
    theirs = times(row.peer)
    ratio = statistics.median(b / a for a, b in zip(ours, theirs))
    return (f"| {row.what} | {statistics.median(ours):.1f} | {statistics.median(theirs):.1f} | {ratio:.2f}x | {row.aim:g}x | "
            f"{'met' if ratio >= row.aim else 'missed'} |")


def main() -> None:
    candela = str(pathlib.Path(sys.argv[1]).resolve() / "candela")
    rounds = int(sys.argv[2]) if len(sys.argv) > 2 else 5
    with tempfile.TemporaryDirectory(prefix="candela-compare-") as scratch:
        make_frames(pathlib.Path(scratch))
        os.chdir(scratch)
        costs, failed = measure(tools(candela, "--max-size" in run(candela, "render", "--help")), rounds)
        os.chdir("/")
    print(f"{rounds} rounds in turn, {len(os.sched_getaffinity(0))} cores; frames of {WIDTH}x{HEIGHT}, half ZIP with noise\n")
    print("| from files to files | Candela, processor ms | the peer | peer / Candela | aim | |\n|---|--:|--:|--:|--:|---|")
    for row in ROWS:
        print(line(row, costs, failed))


if __name__ == "__main__":
    main()
