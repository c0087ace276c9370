"""The option table: for every option of every command, a check of checks.py that shows what the option does."""
import json

from checks import (FFMPEG, GUARDS, LINES, OUTPUTS, SERVERS, alpha, at_home, bench_encodings, both, changes, device, each_word, elsewhere,
                    encodings, executor, films, guarded, json_of, late, named, needs, one_file, pipe_matrices, pipes, plural, public, quick_report, quiet, refuses,
                    shows, sizes, waits)

INPUT = {  # of render, contact, stream, meter, view and environment
    "--bad-values": lambda c: needs("--bad-values scrub", "--bad-values reject",
                                    f"{c} nan.pfm {OUTPUTS[c]} --json - -q --server PLAIN {{}}", "NaN"),
    "--primaries": lambda c: each_word("--primaries"),
    "--layer": lambda c: changes("--layer key", line=one_file(c, "layers")),
    "--rows": lambda c: changes("--rows top", "--spot 0,0,8,1" if c == "meter" else "",
                                f"{c} rows.0001.pfm {OUTPUTS[c]} --json - -q --server PLAIN {{}}"),
    "--input-transfer": lambda c: changes("--input-transfer linear", "--spot 0,0,8,1" if c == "meter" else "",
                                          f"{c} codes.0001.png {OUTPUTS[c]} --json - -q --server PLAIN {{}}"),
    "--input-matrix": lambda c: changes("--input-matrix bt601", "--spot 0,0,8,1" if c == "meter" else "",
                                        f"{c} matrix.0001.avif {OUTPUTS[c]} --json - -q --server PLAIN {{}}"),
    "--input-range": lambda c: changes("--input-range limited", "--spot 0,0,8,1" if c == "meter" else "",
                                       f"{c} codes.0001.png {OUTPUTS[c]} --json - -q --server PLAIN {{}}"),
    "--hlg-peak": lambda c: changes("--hlg-peak 400", "--spot 0,0,8,1" if c == "meter" else "",
                                    f"{c} codes.0001.png {OUTPUTS[c]} --json - -q --server PLAIN {{}}"),
    "--part": lambda c: changes("--part sun", line=one_file(c, "parts")),
    "--incomplete": lambda c: needs("--incomplete fill", "--incomplete error",
                                    f"{c} cut.pfm {OUTPUTS[c]} --json - -q --server PLAIN {{}}", "--incomplete fill"),
    "--max-chunk-mib": lambda c: needs("--max-chunk-mib 2", "--max-chunk-mib 1",
                                       f"{c} chunk.exr {OUTPUTS[c]} --json - -q --server PLAIN {{}}", "--max-chunk-mib"),
    "--max-pixels": lambda c: needs("--max-pixels 100000000", "--max-pixels 5", words="--max-pixels allows 5"),
    "--exr-view": lambda c: changes("--exr-view right", line=one_file(c, "views")),
}
FINISHED = {  # of render, contact, stream, meter and view
    "--scene-light": lambda c: changes("--scene-light", "--spot 0,0,8,1" if c == "meter" else "",
                                       f"{c} codes.0001.png {OUTPUTS[c]} --json - -q --server PLAIN {{}}"),
}
CHOSEN = {  # of render, contact, stream, meter and info
    "--only": lambda c: both(needs("--only png,exr", "--only png,hdr", words=".png", line="info scene.exr {}" if c == "info" else ""),
                             refuses("--only a/b", words="--only")),
}
METERED = {  # of render, stream, meter and view
    "--white-balance": lambda c: changes("--white-balance 3200"),
    "--tint": lambda c: changes("--tint 0.5", "--white-balance 5000"),
    "--exposure": lambda c: changes("--exposure 2"),
    "--compensation": lambda c: changes("--compensation 1"),
    "--key": lambda c: changes("--key 0.3"),
    "--min-exposure": lambda c: changes("--min-exposure 30"),
    "--max-exposure": lambda c: changes("--max-exposure 0.1"),
    "--metering": lambda c: each_word("--metering"),
    "--percentiles": lambda c: changes("--percentiles 60,99"),
    "--weights": lambda c: each_word("--weights", but=("spot",)),
    "--spot": lambda c: changes("--spot 0,0,9,9"),
    "--ignore-below": lambda c: changes("--ignore-below 0.2"),
}


OVER = {"--alpha": alpha}  # of frames, which may have alpha
SQUEEZED = {  # of render and stream
    "--desqueeze": lambda c: shows(one_file(c, "wide").format("--desqueeze"), lambda run: sizes(run) == {(32, 12, 1)}, "not 32x12"),
}
BEHIND = {  # of render, contact and stream
    "--sdr": lambda c: changes("--sdr curve", "", f"{c} map.0001.jpg {OUTPUTS[c]} --json - -q --server PLAIN {{}}"),
    "--background": lambda c: changes("--background 0.5,0.2,1", "--alpha over", one_file(c, "alpha")),
}
DRAWN = {  # of render, contact, stream and view
    "--locked-exposure": lambda c: changes("--locked-exposure shot.json"),
    "--curve": lambda c: each_word("--curve"),
    "--curve-white": lambda c: changes("--curve-white 2", "--curve reinhard-extended"),
    "--prescale": lambda c: changes("--prescale 2"),
    "--transfer": lambda c: each_word("--transfer", but=("pq", "hlg") if c == "contact" else ()),
    **{option: (lambda c, o=option, v=value, beside=beside: refuses(f"{o} {v}", words="HDR displays") if c == "contact" and o != "--source-peak" else changes(
        f"{o} {v}", beside)) for option, value, beside in (
            ("--peak", "600", "--transfer pq"), ("--source-peak", "400", "--curve shoulder"),
            ("--display-primaries", "p3-d65", "--transfer pq"), ("--limit", "rec2020", "--transfer pq --curve aces-2"))},
    "--gain-map": lambda c: refuses("--gain-map 1000", words="--gain-map") if c == "contact" else changes(
        "--gain-map 1000", line=LINES[c].replace(".png", ".jpg")),
    "--tier": lambda c: each_word("--tier", words=("draft", "standard", "reference")),
    "--dither": lambda c: changes("--dither"),
    "--resize": lambda c: both(*(shows(LINES[c].format(f"--resize {size}"), lambda run: {s[0] for s in sizes(run)} == {24}, "not 24 wide")
                                 for size in ("24x", "24x9")), needs("--resize 50%", "--resize 50", words="WIDTHxHEIGHT")),
    "--max-size": lambda c: both(shows(LINES[c].format("--max-size 24"), lambda run: {s[:2] for s in sizes(run)} == {(24, 16)}, "not 24x16"),
                                 refuses("--max-size 0", words="--max-size")),
    # Each takes another tier than the default: 0 only the reference keeps, 255 any.
    "--max-error": lambda c: both(each_word("--max-error", words=("0", "255")), refuses("--max-error -1", words="--max-error")),
    "--bloom": lambda c: each_word("--bloom"),
    "--bloom-intensity": lambda c: changes("--bloom-intensity 1"),
    "--bloom-threshold": lambda c: changes("--bloom-threshold 3", "--bloom-intensity 1"),
    "--bloom-softness": lambda c: changes("--bloom-softness 0", "--bloom-intensity 1 --bloom-threshold 0.5"),
    "--bloom-levels": lambda c: changes("--bloom-levels 2", "--bloom-intensity 1"),
    "--bloom-firefly": lambda c: changes("--bloom-firefly off", "--bloom-intensity 1"),
    "--ocio": lambda c: changes("--ocio studio.ocio"),
    "--lut": lambda c: changes("--lut look.cube"),
    "--lut-input": lambda c: changes("--lut-input acescct", "--lut look.cube"),
    "--lut-domain": lambda c: both(changes("--lut-domain 0,4", "--lut look.cube"), refuses("--lut-domain 4,1", LINES[c] + " --lut look.cube", "below the second")),
    "--ocio-input": lambda c: changes("--ocio-input Other", "--ocio studio.ocio"),
    "--display": lambda c: changes("--display Projector", "--ocio studio.ocio"),
    "--ocio-view": lambda c: changes("--ocio-view Dark", "--ocio studio.ocio"),
}
CODED = {  # of render, stream and view
    "--bits": lambda c: changes("--bits 16"),
    "--quality": lambda c: changes("--quality 20", line=LINES[c].replace(".png", ".jpg")),
}
ALONE = "an image by itself takes its target"
SHEETS = {  # of contact alone
    **{option: (lambda c, given=f"{option} {value}": shows(f"contact scene.exr OUT/o.png --server PLAIN {given}",
                                                           lambda run: ALONE in run.err, "nothing says that it is idle"))
       for option, value in (("--adaptation", "log"), ("--speed-up", "2"), ("--speed-down", "2"))},
    "--resize": lambda c: changes("--resize 24x"),
    "--max-size": lambda c: changes("--max-size 24"),
    "--columns": lambda c: changes("--columns 1", line="contact film OUT/o.png --json - -q --server PLAIN {}"),
    "--resume": lambda c: waits(LINES[c]),
    "--verbose": lambda c: shows("contact scene.exr OUT/o.png -v --server PLAIN",
                                 lambda run: len((run.out + run.err).splitlines()) > 4, "-v prints no more than a line"),
}
SEQUENCED = {  # of stream and meter
    "--range": lambda c: changes("--range 1-4x2", line=plural("film")[c]),
    "--missing": lambda c: each_word("--missing", line=plural("gap")[c], but=("error",)),
    "--cut-at": lambda c: changes("--cut-at 3", line=plural("film")[c]),
    "--fps": lambda c: changes("--fps 2", line=plural("film")[c]),
    "--lookahead": lambda c: changes("--lookahead 2", line=plural("film")[c]),
    "--detect-cuts": lambda c: changes("--detect-cuts 2", line=plural("film")[c]),
    "--state": lambda c: changes("--state begun.json", "--range 3-", plural("film")[c]),
    "--adaptation": lambda c: each_word("--adaptation", line=plural("film")[c]),
    "--speed-up": lambda c: changes("--speed-up 0.1", line=plural("film")[c]),
    "--speed-down": lambda c: changes("--speed-down 0.1", line=plural("film")[c]),
    "--frame-timeout": lambda c: late(c),
    "--skip-bad": lambda c: needs("--skip-bad", "", plural("broken")[c], "0001.exr"),
    "--exposure-plot": lambda c: shows(plural("film")[c].format("--exposure-plot OUT/plot.svg"),
                                       lambda run: b"<svg" in run.files["plot.svg"], "the plot is no SVG"),
    "--save-exposures": lambda c: shows(plural("film")[c].format("--save-exposures OUT/exposures.json"),
                                        lambda run: len(json.loads(run.files["exposures.json"])["frames"]) == 6, "not 6 frames"),
    "--session": lambda c: named(plural("film")[c]),
    "--transport": lambda c: refuses("--transport memory", plural("film")[c], words="unix:PATH"),
    "--resume": lambda c: waits(plural("film")[c]),
}
MOMENT = "--previous-exposure 0.01 --elapsed 0.2 "
MOMENTARY = {  # of render and view
    "--previous-exposure": lambda c: changes("--previous-exposure 0.01 --elapsed 0.1"),
    "--elapsed": lambda c: changes("--elapsed 2", "--previous-exposure 0.01"),
    "--adaptation": lambda c: each_word("--adaptation", MOMENT),
    "--speed-up": lambda c: changes("--speed-up 0.1", MOMENT),
    "--speed-down": lambda c: changes("--speed-down 9", "--previous-exposure 60 --elapsed 0.2"),
    "--resume": lambda c: waits(LINES[c]),
}
VERIFIED = {
    "--verify": lambda c: shows(LINES[c].format("--verify"), lambda run: "verify" in run.lines()[0], "no verify in it"),
    "--error-map": lambda c: shows(LINES[c].format("--error-map OUT/map.png"),
                                   lambda run: run.files["map.png"].startswith(b"\x89PNG"), "there is no map"),
}
RENDERED = {  # of render alone
    "--hdr-curve": lambda c: each_word("--hdr-curve", "--gain-map 1000", "render scene.exr OUT/o.jpg -q --server PLAIN {}"),
    "--as": lambda c: each_word("--as", line="render scene.exr alpha.exr OUT/all/ -q --server PLAIN {}"),
    "--verbose": lambda c: shows("render scene.exr OUT/o.png -v --server PLAIN",
                                 lambda run: len((run.out + run.err).splitlines()) > 3, "-v prints no more than a line"),
}
TURN = "view pano.exr OUT/%04d.png --size 32x24 --frames 4 --json - -q --server PLAIN --turn 90 {}"
VIEWED = {  # of view alone
    "--yaw": lambda c: changes("--yaw 50"),
    "--pitch": lambda c: changes("--pitch 50"),
    "--roll": lambda c: changes("--roll 50"),
    "--fov": lambda c: changes("--fov 50"),
    "--size": lambda c: changes("--size 32x48"),
    "--samples": lambda c: each_word("--samples", "--objects lookdev", words=("1", "4", "16")),
    "--rotation": lambda c: changes("--rotation 50"),
    "--objects": lambda c: changes("--objects lookdev"),
    "--turn": lambda c: changes("--turn 80", line=TURN),
    "--path": lambda c: shows(TURN.replace("--turn 90", "--path keys.json").format(""), lambda run: len(run.files) == 4, "no 4 files"),
    "--frames": lambda c: shows(TURN.format("--frames 2"), lambda run: len(run.files) == 2, "no 2 files"),
    "--fps": lambda c: changes("--fps 2", line=TURN),
    "--lookahead": lambda c: changes("--lookahead 2", line=TURN),
    "--session": lambda c: named(TURN),
    "--encoding": lambda c: needs("--encoding png", "--encoding webp", TURN, "webp"),
    "--exposure-plot": lambda c: shows(TURN.format("--exposure-plot OUT/plot.svg"),
                                       lambda run: b"<svg" in run.files["plot.svg"], "the plot is no SVG"),
    "--verbose": lambda c: shows("view pano.exr OUT/o.png --size 8x8 -v --server PLAIN",
                                 lambda run: len((run.out + run.err).splitlines()) > 3, "-v prints no more than a line"),
}
BAKED = {  # of environment alone
    "--size": lambda c: changes("--size 16"),
    "--levels": lambda c: changes("--levels 1"),
    "--roughness-mapping": lambda c: each_word("--roughness-mapping", "--size 64"),
    "--layout": lambda c: each_word("--layout", line=LINES[c].replace(".ktx2", ".exr"), words=("equirectangular", "cross")),
    "--handedness": lambda c: each_word("--handedness", words=("left", "right")),
    "--rotation": lambda c: changes("--rotation 50"),
    "--format": lambda c: each_word("--format"),
    "--tier": lambda c: each_word("--tier", words=("draft", "standard", "reference")),
    "--verify": lambda c: shows(LINES[c].format("--verify"), lambda run: run.lines()[0]["levels"][0]["error"] > 0, "no error"),
    "--sh": lambda c: shows(LINES[c].format("--sh OUT/sh.json"),
                            lambda run: len(json.loads(run.files["sh.json"])["radiance"]) == 9, "no 9 coefficients"),
    "--preview": lambda c: shows(LINES[c].format("--preview OUT/p.png"),
                                 lambda run: run.files["p.png"].startswith(b"\x89PNG"), "there is no preview"),
    "--resume": lambda c: waits(LINES[c]),
}
STREAMED = {  # of stream alone
    "--exposures": lambda c: changes("--exposures shot.json", "--speed-up 1000 --speed-down 1000", plural("film")[c]),
    "--encoding": lambda c: encodings,
    "--pipe": lambda c: pipes,
    "--pipe-matrix": lambda c: pipe_matrices,
    "--codec": lambda c: both(films, refuses("--codec divx", "stream film OUT/o.mp4 -q {}", "divx"),
                              refuses("--codec h264", LINES["stream"], "--codec h264 is for films")),
    "--verbose": lambda c: shows("stream film OUT/o.mp4 -v --server PLAIN" if FFMPEG else "stream film OUT/%04d.png -v --server PLAIN",
                                 lambda run: "note: ffmpeg -" in run.err if FFMPEG else "-v changes nothing" in run.err, "-v says nothing"),
    "--first": lambda c: shows(LINES["stream"].format("--first 100"), lambda run: "0100.png" in run.files, "no 0100.png"),
}
OTHERS = {
    "info": {"--ocio": both(shows("info --ocio studio.ocio", lambda run: 'view "Dark"' in run.out, "no view"),
                            refuses("--ocio no-such.ocio", "info {}", "no-such.ocio"))},
    "meter": {"--tier": changes("--tier reference")},
    "sample": {"--size": changes("--size 9x5", line="sample OUT/s.pfm -q {}", base="--size 8x8"),
               "--sequence": shows("sample --sequence OUT --size 8x8 --frames 3 -q", lambda run: len(run.files) == 3, "no 3 files"),
               "--panorama": shows("sample --panorama OUT/p.exr --size 16x8 -q", lambda run: len(run.files) == 1, "no file"),
               "--frames": changes("--frames 3", line="sample --sequence OUT --size 8x8 -q {}")},
    "bench": {"--sessions": shows(LINES["bench"].format("--sessions 2"), lambda run: run.lines()[0]["sessions"] == 2, "not 2"),
              "--size": shows(LINES["bench"].format(""), lambda run: run.lines()[0]["width"] == 64, "not 64 wide"),
              "--fps": shows(LINES["bench"].format("--fps 10"), lambda run: run.lines()[0]["frames"] <= 5, "more frames than that"),
              "--seconds": shows(LINES["bench"].format(""), lambda run: run.lines()[0]["seconds"] < 1, "it took longer"),
              "--lookahead": both(  # four frames at 20 a second
                  shows(LINES["bench"].format("--fps 20 --seconds 1 --lookahead 4"), lambda run: run.lines()[0]["latency_ms"]["p50"] > 150,
                        "results come before their look-ahead"),
                  shows(LINES["bench"].format("--fps 20 --seconds 1"), lambda run: run.lines()[0]["latency_ms"]["p50"] < 150,
                        "results come late without look-ahead"),
                  refuses("--lookahead 17", words="--lookahead")),
              "--frame-timeout": both(
                  shows(LINES["bench"].format("--size 1280x720 --frame-timeout 0.001"), lambda run: run.lines()[0]["failed"] > 0,
                        "no frame came too late"),
                  refuses("--frame-timeout 0", words="--frame-timeout")),
              "--transport": both(
                  shows(LINES["bench"].format("--transport grpc"), lambda run: run.lines()[0]["transport"] == "grpc", "not by grpc"),
                  refuses("--transport memory", words="unix:PATH"), refuses("--transport pigeon", words="pigeon")),
              "--encoding": both(bench_encodings, refuses("--encoding webp", words="webp"))},
    # Health needs no token, but a file that is named must be there.
    "health": {"--timeout": needs("--timeout 5", "--timeout 0", words="--timeout"),
               "--token-file": refuses("--token-file no-such-file", words="no-such-file")},
    # A report takes half a minute, so one shows all that it can show.
    "report": {"--quick": quick_report, "--quiet": quick_report, "--megapixels": quick_report, "--images": quick_report,
               "--panoramas": quick_report,
               "--server": refuses("--server 127.0.0.1:1", "report OUT --quick {}", "127.0.0.1:1"),
               "--device": refuses("--device no-such-device", "report OUT --quick {}", "no-such-device"),
               "--executor": refuses("--executor nobody", "report OUT --quick {}", "nobody")},
}


def table(command: str) -> dict:
    """The checks of a command by option."""
    rows = {}
    for group, commands in ((INPUT, ("render", "contact", "stream", "meter", "view", "environment")),
                            (FINISHED, ("render", "contact", "stream", "meter", "view")),
                            (CHOSEN, ("render", "contact", "stream", "meter", "info")),
                            (METERED, ("render", "contact", "stream", "meter", "view")), (OVER, ("render", "contact", "stream", "meter")),
                            (BEHIND, ("render", "contact", "stream")), (SQUEEZED, ("render", "stream")), (DRAWN, ("render", "contact", "stream", "view")),
                            (CODED, ("render", "stream", "view")),
                            (SEQUENCED, ("stream", "meter")), (MOMENTARY, ("render", "view")),
                            (VERIFIED, ("render", "view")), (RENDERED, ("render",)), (SHEETS, ("contact",)), (STREAMED, ("stream",)),
                            (VIEWED, ("view",)), (BAKED, ("environment",))):
        if command in commands:
            rows |= {option: check(command) for option, check in group.items()}
    rows |= {option: guarded(option) for option in GUARDS if command != "sample"}
    if command != "sample":
        rows["--tls"] = public
    if command in LINES and command != "health":
        rows["--json"] = json_of(command)
    if command not in ("info", "health"):
        rows["--quiet"] = quiet(command)
    if command in SERVERS:
        rows["--device"] = device(command)
        rows["--executor"] = executor(command)
    if command != "sample":
        rows["--server"] = elsewhere(at_home(command))
    rows |= OTHERS.get(command, {})
    rows["--help"] = shows(f"{command} --help", lambda run: "Usage:" in run.out, "it prints no usage")
    return rows
