"""The net's commands: every setting one at a time, pairs on a few scenes, sessions, and wrong invocations."""
import dataclasses
import itertools
import json
import pathlib
from collections.abc import Callable, Iterator

CURVES = ("linear", "reinhard", "aces-narkowicz", "aces-hill", "reinhard-extended", "hable", "agx", "pbr-neutral", "shoulder",
          "aces-1", "aces-2")
DCI_P3 = "0.68,0.32,0.265,0.69,0.15,0.06,0.314,0.351"

METERING = ["--metering log-average", "--metering percentile", "--percentiles 1,99", "--percentiles 50,95",
            "--weights average", "--weights center", "--spot 3,2,40,30", "--metering percentile --weights center"]
BLOOM = ["--bloom mip", "--bloom conserve", "--bloom gaussian", "--bloom-intensity 0", "--bloom-intensity 0.7",
         "--bloom-threshold 0", "--bloom-threshold 4", "--bloom-softness 0", "--bloom-softness 1", "--bloom-levels 1",
         "--bloom-levels 16", "--bloom-firefly off", "--bloom conserve --bloom-intensity 0.3",
         "--bloom gaussian --bloom-threshold 2 --bloom-levels 8"]
EXPOSURE = ["--exposure -2", "--exposure 3.5", "--compensation 1.5", "--compensation -3", "--key 0.09",
            "--min-exposure 2", "--max-exposure 0.02", "--previous-exposure 3 --elapsed 0.2",
            "--previous-exposure 3 --elapsed 0.2 --adaptation linear --speed-up 5 --speed-down 0.5"]
TONE = [*(f"--curve {curve}" for curve in CURVES), "--curve reinhard-extended --curve-white 2.5", "--prescale 0.5",
        "--prescale 3", "--transfer srgb", "--transfer gamma22", "--transfer linear", "--dither",
        "--bad-values scrub", "--bad-values reject",
        *(f"--primaries {name}" for name in ("rec709", "rec2020", "p3-d65", "aces-ap0", "aces-ap1", "xyz", DCI_P3))]
ALPHA = ["--alpha associated", "--alpha straight", "--alpha over", "--alpha ignore", "--background 0.2,1,3"]
WITH_ALPHA = ("exr/CandleGlass.exr", "display_window/t15.exr")
TIERS = ["--tier draft", "--tier standard", "--tier reference"]
HDR = ["--transfer pq", "--transfer pq --curve linear --display-primaries p3-d65", "--transfer hlg --curve aces-2",
       "--transfer pq --peak 600 --source-peak 4000", "out.jpg --gain-map 1000", "out.avif --transfer hlg"]
OUTPUTS = ["out.png", "out.png --bits 16", "out.png --bits 16 --dither", "out.jpg", "out.jpg --quality 40", "out.exr",
           "out.pfm"]
PAIRED = ["--curve agx", "--curve aces-1", "--metering percentile", "--weights center", "--spot 3,2,40,30",
          "--bloom conserve", "--bloom gaussian", "--bloom-intensity 0", "--bloom-firefly off", "--tier draft",
          "--dither", "--transfer gamma22", "--prescale 0.5", "--primaries aces-ap0", "--exposure -1",
          "--compensation 1"]
PAIRED_SCENES = ("bad-values.pfm", "letterbox.pfm")
OTHER_WHOLE_SCENES = ("sample-64x48.pfm", "sample-131x67.pfm")
LARGE_SCENE = "sample-1920x1080.exr"
# The options for real images and the other scenes. The outputs are .pfm files, because halves of linear light show
# differences that 8 bits hide.
SHORT_LIST = [*(f"--curve {curve}" for curve in CURVES), "--metering percentile", "--weights center",
              "--spot 3,2,40,30", "--bloom conserve", "--bloom gaussian", "--bloom-intensity 0", "--tier draft"]
FEW = ["--curve agx", "--curve aces-1", *SHORT_LIST[len(CURVES):]]  # for large images
PANORAMAS = ("dikhololo_night", "kiara_1_dawn", "studio_small_03")  # hard cuts, as a session's frames
HUGE, LARGE, SMALL = 2_000_000, 500_000, 70_000  # pixels

SESSIONS = ["out.png", "out.png --lookahead 4", "out.png --detect-cuts", "out.png --detect-cuts 0.5 --lookahead 2",
            "out.png --encoding png", "out.png --encoding png --bits 16", "out.jpg --encoding jpeg --quality 60",
            "out.png --adaptation linear", "out.exr --tier draft"]
MORE_SESSIONS = ["out.exr", "out.jpg", "out.pfm", "out.png --bits 16", "out.png --fps 60",
                 "out.png --speed-up 0 --speed-down 0", "out.png --speed-up 1000 --speed-down 1000",
                 "out.png --adaptation linear --speed-up 0.5 --speed-down 8", "out.png --tier reference",
                 "out.png --tier reference --lookahead 3", "out.png --exposure -1", "out.png --dither --lookahead 1",
                 "out.png --metering percentile --lookahead 16", "out.png --weights center",
                 "out.png --bloom gaussian --detect-cuts", "out.png --bloom conserve --curve agx",
                 "out.png --curve aces-1", "out.png --first 7", "out.png --max-exposure 2 --min-exposure 0.5"]

WRONG = ["--curve filmic", "--metering median", "--weights edge", "--bloom star", "--tier best", "--transfer log",
         "--transfer pq --curve agx", "--transfer hlg --peak 300", "--peak 1000", "--transfer pq --bits 8", "--gain-map 1000",
         "--primaries rec601", "--primaries 0.1,0.2", "--primaries 0.3,0.3,0.3,0.3,0.3,0.3,0.3,0.3",
         "--bad-values keep", "--adaptation square", "--exposure bright", "--exposure 41", "--exposure nan",
         "--compensation -41", "--key 0", "--min-exposure 0", "--max-exposure 1e13",
         "--min-exposure 4 --max-exposure 2", "--speed-up -1", "--speed-down 1001", "--previous-exposure 0",
         "--elapsed -1", "--percentiles 50", "--percentiles 60,40", "--percentiles 0,101", "--spot 5,5,5,5",
         "--spot 9000,0,9001,1", "--spot 1,2,3", "--weights spot", "--bloom-intensity -1", "--bloom-intensity 11",
         "--bloom conserve --bloom-intensity 2", "--bloom-threshold -1", "--bloom-threshold 70000",
         "--bloom-softness 2", "--bloom-levels 0", "--bloom-levels 17", "--bloom-levels 2.5", "--bloom-firefly maybe",
         "--curve-white 0", "--prescale 0", "--prescale inf", "--max-error -1", "--max-error 256",
         "--tier draft --max-error 1", "--bits 12", "--quality 0", "--quality 101",
         "--alpha premultiplied", "--background 1,2", "--background 1,2,-1", "--alpha ignore --background 1,1,1",
         "--no-such-option", "--ocio no-such-file.ocio", "--display sRGB", "--error-map out.txt",
         "--device no-such-device"]
WRONG_COMMANDS = ["", "paint", "render", "render {scenes}/natural.pfm",
                  "render {scenes}/no-such-file.exr {out}/out.png", "render {scenes}/natural.pfm {out}/out.gif",
                  "render {scenes}/natural.pfm {out}/no-such-folder/out.png",
                  "render {scenes}/natural.pfm {out}/out.png --server unix:{out}/no-such-socket",
                  "stream {scenes}/no-such-folder {out}", "stream {scenes}/sequence {out}/out.png --lookahead 17",
                  "stream {scenes}/sequence {out} --fps 0", "stream {scenes}/sequence {out} --detect-cuts 17",
                  "stream {scenes}/sequence {out} --encoding webp", "stream {scenes}/sequence {out} --session a/b",
                  "stream {scenes}/sequence {out} --frame-timeout 0", "meter {scenes}/no-such-file.exr", "sample",
                  "sample {out}/a.exr --size 0x5", "sample {out}/a.png", "sample --sequence {out}/s --frames 1",
                  "info --server unix:{out}/no-such-socket", "health --server unix:{out}/no-such-socket", "--version",
                  "--help", "render --help"]
WRONG_DAEMONS = ["--listen nowhere", "--listen 0.0.0.0:0", "--memory-budget 1", "--memory-budget lots",
                 "--max-frame-bytes 5GiB", "--max-dimension 0", "--max-dimension 16385", "--max-calls 0",
                 "--max-sessions 4097", "--max-frames-in-flight 17", "--encoder-threads 257", "--idle-timeout 1ms",
                 "--drain-timeout 2h", "--pre-drain 11m", "--resume-ttl 0s", "--resume-keys no-such-file",
                 "--metrics nowhere", "--log-level loud", "--config no-such-file", "--device no-such-device",
                 "--tls-cert no-such-file", "--no-such-option", "--version", "--help"]


@dataclasses.dataclass
class Case:
    name: str
    small: bool = False
    program: str = "candela"
    arguments: tuple[str, ...] = ()
    only_exit: bool = False
    call: Callable | None = None  # instead of a program


def command(text: str, small: bool = False, server: bool = True, json_too: bool = True, only_exit: bool = False,
            program: str = "candela") -> Case:
    """A case from a command line. {scenes}, {data} and {out} stand for folders and are not part of its name."""
    arguments = tuple(text.split())
    if server:
        arguments += ("--server", "{server}")
    if json_too:
        arguments += ("--json", "-")
    name = f"{program} {text}" if program != "candela" else text or "no command"
    for folder in ("{scenes}/", "{data}/", "{out}/"):
        name = name.replace(folder, "")
    if not server and json_too:
        name += " (built-in server)"
        arguments += ("--executor", "device")  # the variable is candelad's
    return Case(name, small, program, arguments, only_exit)


def render(path: str, options: str, small: bool = False) -> Case:
    output, _, rest = options.partition(" ") if options.startswith("out.") else ("out.png", "", options)
    return command(f"render {path} {{out}}/{output} {rest}".strip(), small)


def scene_cases(scenes: list[str]) -> Iterator[Case]:
    for scene in scenes:
        path, chosen = f"{{scenes}}/{scene}", scene in PAIRED_SCENES
        if chosen or scene in OTHER_WHOLE_SCENES:
            settings = EXPOSURE + METERING + BLOOM + TONE + HDR + ALPHA + TIERS
        else:
            settings = SHORT_LIST + ([] if scene == LARGE_SCENE else ["--tier reference"])
        for options in OUTPUTS + settings:
            is_file = options.startswith("out.")
            yield render(path, options, scene == "sample-64x48.pfm" or (scene == "bad-values.pfm" and is_file))
        yield command(f"meter {path}", scene in ("natural.pfm", "black.pfm"))
        if chosen:
            for first, second in itertools.combinations(PAIRED, 2):
                if first.split()[0] != second.split()[0]:
                    yield render(path, f"out.pfm {first} {second}")
            yield render(path, "--max-error 0")
            for options in METERING:
                yield command(f"meter {path} {options}")
        if chosen or scene == "natural.pfm":
            yield render(path, "--verify", scene == "natural.pfm")
            yield render(path, "--verify --tier draft --curve aces-1")
            yield render(path, "--error-map {out}/error.png --bloom gaussian")


def data_files(data: pathlib.Path) -> list[tuple[str, int]]:
    """The good still images and a few frames of the sequences, with their numbers of pixels."""
    frames = ("sequence/beachball/singlepart.0001.exr", "sequence/beachball_multipart/multipart.0001.exr",
              "sequence/pan_apartment/frame.0001.exr", "sequence/pan_apartment/frame.0020.exr")
    out = []
    for entry in json.loads((data / "manifest.json").read_text(encoding="utf-8")):
        path = entry["file"]
        if path.endswith((".exr", ".hdr")) and (path in frames or not path.startswith(("bad/", "sequence/"))):
            out.append((path, (entry.get("width") or 0) * (entry.get("height") or 0)))
    return out


def data_cases(data: pathlib.Path) -> Iterator[Case]:
    for file, pixels in data_files(data):
        path = f"{{data}}/{file}"
        yield render(path, "out.png")
        yield command(f"meter {path}")
        if file in WITH_ALPHA:
            for output, options in itertools.product(("out.png --bits 16", "out.exr"), ALPHA):
                yield render(path, f"{output} {options}")
            yield command(f"meter {path} --alpha ignore")
        if pixels > HUGE:
            yield render(path, "out.exr --tier draft")
            continue
        for options in OUTPUTS[1:2] + OUTPUTS[3:4] + OUTPUTS[5:6]:
            yield render(path, options)
        for options in (FEW if pixels > LARGE else SHORT_LIST) + (["--tier reference"] if pixels <= SMALL else []):
            yield render(path, f"out.pfm {options}")
    for path in sorted((data / "bad").iterdir()):
        yield command(f"render {{data}}/bad/{path.name} {{out}}/out.png", only_exit=True)
    panoramas = " ".join(f"{{data}}/hdri/{name}_1k.hdr" for name in PANORAMAS)
    for frames in ("{data}/sequence/pan_apartment", "{data}/sequence/beachball", panoramas):
        for options in ("", " --lookahead 4 --detect-cuts", " --encoding jpeg"):
            kind = "jpg" if "jpeg" in options else "png"
            yield command(f"stream {frames} {{out}}/%04d.{kind}{options}")


def session_cases() -> Iterator[Case]:
    for options in SESSIONS + MORE_SESSIONS:
        line = options.replace("out.", "{out}/%04d.")
        yield command(f"stream {{scenes}}/sequence {line}", options in SESSIONS)
    for options in ("", " --detect-cuts", " --detect-cuts 2 --lookahead 3"):
        yield command(f"stream {{scenes}}/cuts {{out}}/%04d.png{options}", "lookahead" in options)
    yield command("stream {scenes}/damaged {out}/%04d.png --skip-bad", True)
    yield command("stream {scenes}/damaged {out}/%04d.png --skip-bad --lookahead 3")
    yield command("stream {scenes}/damaged {out}/%04d.png", only_exit=True)
    rejected = "{scenes}/sequence/0000.pfm {scenes}/bad-values.pfm"
    yield command(f"stream {rejected} {{out}}/%04d.png --bad-values reject --skip-bad", True)


def other_cases() -> Iterator[Case]:
    yield command("info", True)
    yield command("health", True, json_too=False)
    for size in ("1x1", "33x21", "640x360"):
        yield command(f"sample {{out}}/sample.exr --size {size}", size == "33x21", server=False, json_too=False)
    yield command("sample --sequence {out}/%04d.exr --frames 5 --size 40x30", True, server=False, json_too=False)
    for line in ("render {scenes}/natural.pfm {out}/out.png", "meter {scenes}/natural.pfm", "info",
                 "stream {scenes}/sequence {out}/%04d.png --lookahead 2"):
        yield command(line, line == "info", server=False)
    for options in WRONG:
        device = "--device" in options
        yield command(f"render {{scenes}}/natural.pfm {{out}}/out.png {options}", True, not device, not device,
                      only_exit=True)
    for line in WRONG_COMMANDS:
        yield command(line, line.startswith("render"), server=False, json_too=False, only_exit=True)
    for options in WRONG_DAEMONS:
        yield command(options, True, server=False, json_too=False, only_exit=True, program="candelad")
