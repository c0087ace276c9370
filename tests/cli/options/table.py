"""The option table: for every option of every command, a run that shows what the option does.

Each entry is a check, a function of the workbench that raises Wrong. A line of options is written as on the command line.
`changes` and `each_word` compare results, that is images and numbers: an option that is ignored fails.
"""
import json

from bench import Bench, Run

SERVERS = ("render", "stream", "meter", "view", "environment", "report", "bench", "info")  # that can also render without a daemon
GUARDS = {"--tls-ca": "ca.pem", "--tls-cert": "client.pem", "--tls-key": "client.key", "--tls-name": "candela.test",
          "--token-file": "tokens"}


class Wrong(Exception):
    """An option does not do what it says."""


def hold(true: object, message: str) -> None:
    if not true:
        raise Wrong(message)


def ok(run: Run, line: str) -> Run:
    hold(run.code == 0, f"`candela {line}` ended with {run.code}: {run.err.strip()}")
    return run


# What each command does with a scene, before any option of the table. {} takes them.
LINES = {"render": "render scene.exr OUT/o.png --json - -q --server PLAIN {}",
         "stream": "stream film OUT/%04d.png --fps 24 --json - -q --server PLAIN {}",
         "meter": "meter scene.exr --json - -q --server PLAIN {}",
         "view": "view pano.exr OUT/o.png --size 48x32 --yaw 40 --pitch 20 --json - -q --server PLAIN {}",
         "environment": "environment pano.exr OUT/o.ktx2 --json - -q --server PLAIN {}",
         "info": "info --json - {}", "health": "health --server PLAIN {}",
         "bench": "bench --size 64x36 --seconds 0.3 --json - -q --server PLAIN {}"}


def changes(options: str, base: str = "", line: str = ""):
    """The result with `options` differs from that with `base` alone. `line` replaces the command's usual line."""
    def check(bench: Bench, command: str) -> None:
        full = line or LINES[command]
        without = ok(bench(full.format(base)), full.format(base)).result()
        with_it = ok(bench(full.format(f"{base} {options}")), full.format(options)).result()
        hold(without != with_it, f"`{options}` changes nothing beside `{base}`")
    return check


def each_word(option: str, base: str = "", line: str = "", but: tuple = (), words: tuple = ()):
    """Every choice that the help lists, or each of `words`, gives another result."""
    def check(bench: Bench, command: str) -> None:
        full, seen = line or LINES[command], {}
        for word in words or bench.words(command, option):
            if word in but:
                continue
            filled = full.format(f"{base} {option} {word}")
            result = ok(bench(filled), filled).result()
            hold(result not in seen, f"`{option} {word}` gives the same as `{seen.get(result)}`")
            seen[result] = word
        hold(len(seen) > 1, f"there is only {list(seen.values())}")
    return check


def refuses(bad: str, line: str = "", words: str = ""):
    """`bad` fails in one line, with `words` in it."""
    def check(bench: Bench, command: str) -> None:
        run = bench((line or LINES[command]).format(bad))
        hold(run.code in (1, 2, 3, 4, 5) and len(run.err.strip().splitlines()) == 1,
             f"`{bad}` ended with {run.code}: {run.err.strip()}")
        hold(words in run.err, f"`{bad}` does not speak of '{words}': {run.err.strip()}")
    return check


def needs(good: str, bad: str, line: str = "", words: str = ""):
    """`good` ends well, and `bad` is refused."""
    def check(bench: Bench, command: str) -> None:
        full = line or LINES[command]
        ok(bench(full.format(good)), full.format(good))
        refuses(bad, full, words)(bench, command)
    return check


def both(*checks):
    """Each of the checks."""
    def check(bench: Bench, command: str) -> None:
        for one in checks:
            one(bench, command)
    return check


def logged(line: str, words: str):
    """The server's log has `words` after that whole line, and not before it. The line's server is TOLD."""
    def check(bench: Bench, _: str) -> None:
        hold(words not in bench.told.words(), f"the server said '{words}' before")
        ok(bench(line), line)
        hold(words in bench.told.words(), f"`candela {line}`: the server does not say '{words}'")
    return check


def waits(line: str):
    """A full server is asked again for as long as --resume says, and not at all with 0."""
    full = line.replace("PLAIN", "FULL")
    return both(refuses("--resume 1.5", full, "within 1.5s"), refuses("--resume 0", full, "which is its limit"),
                refuses("--resume -1", line, "--resume"))


def named(line: str):
    """The server knows the session by its name."""
    return both(logged(line.replace("PLAIN", "TOLD").format("--session named-by-the-option"), "session=named-by-the-option"),
                refuses("--session a/b", line, "--session"))


def shows(line: str, holds, what: str):
    """`holds(run)` of that whole line is true."""
    def check(bench: Bench, _: str) -> None:
        run = ok(bench(line), line)
        hold(holds(run), f"`candela {line}`: {what}. It printed: {(run.out + run.err)[:300]}")
    return check


def guarded(option: str):
    """With every secret a guarded server answers; without this one it does not."""
    def check(bench: Bench, command: str) -> None:
        line = {"report": "report OUT --quick --megapixels 0.001 --images alpha.exr -q {}"}.get(
            command, LINES.get(command, "")).replace("PLAIN", "GUARDED")
        line += " --server GUARDED" if command in ("report", "info") else ""
        everything = " ".join(f"{name} {value}" for name, value in GUARDS.items())
        if command != "report":  # it measures for long; --tls-ca's own entry runs it
            ok(bench(line.format(everything)), line.format(everything))
        rest = " ".join(f"{name} {value}" for name, value in GUARDS.items() if name != option)
        hold(bench(line.format(rest)).code in ((1, 2) if command == "health" else (2, 4)), f"a guarded server answers without {option}")
    return check


def public(bench: Bench, command: str) -> None:
    """--tls trusts the system's CAs, so only a server with their certificate answers."""
    line = {"report": "report OUT --quick --megapixels 0.001 --images alpha.exr -q {}"}.get(
        command, LINES.get(command, "")).replace("PLAIN", "PUBLIC")
    line += " --server PUBLIC" if command in ("report", "info") else ""
    run = bench(line.format("--tls"))
    hold(run.code == (1 if command == "health" else 4) and "certificate" in run.err, f"--tls does not check the certificate: {run.err.strip()}")
    if command != "report":
        trusted = line.format("--tls --tls-ca ca.pem --tls-name candela.test")
        ok(bench(trusted), trusted)


def elsewhere(line: str):
    """The address of --server is where the work goes."""
    return needs("--server PLAIN", "--server 127.0.0.1:1", line, "127.0.0.1:1")


def plural(film: str) -> str:
    """The lines of stream and meter for another film."""
    return {"stream": f"stream {film} OUT/%04d.png --json - -q --server PLAIN {{}}",
            "meter": f"meter {film} --json - -q --server PLAIN {{}}"}


# The outputs of one file.
OUTPUTS = {"render": "OUT/o.png", "stream": "OUT/%d.png", "meter": "", "view": "OUT/o.png --size 48x32", "environment": "OUT/o.ktx2"}
INPUT = {  # of render, stream, meter, view and environment
    "--bad-values": lambda c: needs("--bad-values scrub", "--bad-values reject",
                                    f"{c} nan.pfm {OUTPUTS[c]} --json - -q --server PLAIN {{}}", "NaN"),
    "--primaries": lambda c: each_word("--primaries"),
    "--layer": lambda c: changes("--layer key", line=one_file(c, "layers")),
    "--part": lambda c: changes("--part sun", line=one_file(c, "parts")),
    "--incomplete": lambda c: needs("--incomplete fill", "--incomplete error", f"{c} cut.pfm {OUTPUTS[c]} --json - -q --server PLAIN {{}}",
                                    "--incomplete fill"),
    "--max-chunk-mib": lambda c: needs("--max-chunk-mib 2", "--max-chunk-mib 1",
                                       f"{c} chunk.exr {OUTPUTS[c]} --json - -q --server PLAIN {{}}", "--max-chunk-mib"),
    "--max-pixels": lambda c: needs("--max-pixels 100000000", "--max-pixels 5", words="--max-pixels allows 5"),
    "--exr-view": lambda c: changes("--exr-view right", line=one_file(c, "views")),
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


def one_file(command: str, name: str) -> str:
    number = ".0001" if command == "stream" else ""
    return f"{command} {name}{number}.exr {OUTPUTS[command]} --json - -q --server PLAIN {{}}"


def alpha(command: str):
    if command == "meter":
        return changes("--alpha ignore", line=one_file("meter", "alpha"))
    return each_word("--alpha", line=one_file(command, "alpha"), but=("over",))  # over black is what ignore shows


OVER = {  # of frames, which may have alpha
    "--alpha": lambda c: alpha(c),
}
BEHIND = {  # of render and stream
    "--background": lambda c: changes("--background 0.5,0.2,1", "--alpha over", one_file(c, "alpha")),
}
DRAWN = {  # of render, stream and view
    "--locked-exposure": lambda c: changes("--locked-exposure shot.json"),
    "--curve": lambda c: each_word("--curve"),
    "--curve-white": lambda c: changes("--curve-white 2", "--curve reinhard-extended"),
    "--prescale": lambda c: changes("--prescale 2"),
    "--transfer": lambda c: each_word("--transfer"),
    "--tier": lambda c: each_word("--tier", words=("draft", "standard", "reference")),
    "--dither": lambda c: changes("--dither"),
    # Each takes another tier than the default: 0 only the reference keeps, 255 any.
    "--max-error": lambda c: both(each_word("--max-error", words=("0", "255")), refuses("--max-error -1", words="--max-error")),
    "--bloom": lambda c: each_word("--bloom"),
    "--bloom-intensity": lambda c: changes("--bloom-intensity 1"),
    "--bloom-threshold": lambda c: changes("--bloom-threshold 3", "--bloom-intensity 1"),
    "--bloom-softness": lambda c: changes("--bloom-softness 0", "--bloom-intensity 1 --bloom-threshold 0.5"),
    "--bloom-levels": lambda c: changes("--bloom-levels 2", "--bloom-intensity 1"),
    "--bloom-firefly": lambda c: changes("--bloom-firefly off", "--bloom-intensity 1"),
    "--bits": lambda c: changes("--bits 16"),
    "--quality": lambda c: changes("--quality 20", line=LINES[c].replace(".png", ".jpg")),
    "--ocio": lambda c: changes("--ocio studio.ocio"),
    "--ocio-input": lambda c: changes("--ocio-input Other", "--ocio studio.ocio"),
    "--display": lambda c: changes("--display Projector", "--ocio studio.ocio"),
    "--ocio-view": lambda c: changes("--ocio-view Dark", "--ocio studio.ocio"),
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
    "--first": lambda c: shows(LINES["stream"].format("--first 100"), lambda run: "0100.png" in run.files, "no 0100.png"),
}


def encodings(bench: Bench, _: str) -> None:
    """PNG and JPEG come from the server, in files of the same names as the command's own."""
    for word, ending in (("raw", "png"), ("png", "png"), ("jpeg", "jpg")):
        line = f"stream film OUT/%04d.{ending} --json - -q --server PLAIN --encoding {word}"
        run = ok(bench(line), line)
        by_server = run.lines()[0].get("encoding")
        hold(by_server in (word, None), f"--encoding {word} was encoded as {by_server}")
        hold(len(run.files) == 6, f"--encoding {word} wrote {sorted(run.files)}")


def bench_encodings(bench: Bench, _: str) -> None:
    """The server sends fewer bytes for each frame of JPEG than of PNG, and fewer for PNG than raw."""
    bytes_of_frame = []
    for word in ("raw", "png", "jpeg"):
        line = LINES["bench"].replace("PLAIN", "TOLD").format(f"--encoding {word}")
        before = sent_by(bench.told)
        ok(bench(line), line)
        sent, frames = (after - first for after, first in zip(sent_by(bench.told), before))
        bytes_of_frame.append(sent / frames)
    hold(bytes_of_frame[0] > 64 * 36 * 4 and bytes_of_frame == sorted(bytes_of_frame, reverse=True),
         f"frames of raw, png and jpeg have {bytes_of_frame} bytes")


def sent_by(daemon) -> tuple[float, float]:
    """Bytes and frames."""
    return (daemon.series("candela_bytes_total")['direction="out"'], daemon.series("candela_frames_total")['result="ok"'])


def quiet(command: str):
    line = {"sample": "sample OUT/s.exr --size 8x8", "report": "", "bench": LINES["bench"].replace("--json - -q", "")}.get(
        command, LINES.get(command, "").replace("--json - -q", "")).format("")

    def check(bench: Bench, _: str) -> None:
        loud, silent = ok(bench(line), line), ok(bench(line + " -q"), line + " -q")
        hold(loud.out + loud.err and not silent.out + silent.err, f"-q prints: {silent.out + silent.err}")
    return check


def json_of(command: str):
    """The same numbers to a file as to stdout."""
    line = LINES[command].replace("--json -", "--json OUT/numbers.json").format("")
    return shows(line, lambda run: json.loads(run.files["numbers.json"].splitlines()[0]), "the file has no JSON")


def quick_report(bench: Bench, _: str) -> None:
    """One short report through the guarded server, which needs every one of its options."""
    secrets = " ".join(f"{name} {value}" for name, value in GUARDS.items())
    line = f"report OUT --quick --megapixels 0.002 --images alpha.exr --panoramas pano.exr -q --server GUARDED {secrets}"
    run = ok(bench(line, seconds=900), line)
    hold(not run.out and not run.err, f"-q prints: {run.out + run.err}")
    report = json.loads(run.files["report.json"])
    hold(report["quick"] is True, "the report does not say that it was quick")
    pixels = {round(row["width"] * row["height"] / 1e6, 4) for row in report["times"]}
    hold(max(pixels) < 0.01, f"--megapixels 0.002 measured {pixels}")
    hold([image["name"] if isinstance(image, dict) else image for image in report["images"]] == ["alpha.exr"],
         f"--images took {report['images']}")
    hold([panorama["name"] for panorama in report["environments"]] == ["pano.exr"],
         f"--panoramas took {report['environments']}")


def table(command: str) -> dict:
    """The checks of a command by option."""
    rows = {}
    for group, commands in ((INPUT, ("render", "stream", "meter", "view", "environment")),
                            (METERED, ("render", "stream", "meter", "view")), (OVER, ("render", "stream", "meter")),
                            (BEHIND, ("render", "stream")), (DRAWN, ("render", "stream", "view")),
                            (SEQUENCED, ("stream", "meter")), (MOMENTARY, ("render", "view")),
                            (VERIFIED, ("render", "view")), (RENDERED, ("render",)), (STREAMED, ("stream",)),
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
        rows["--device"] = needs("--device llvmpipe", "--device no-such-device", at_home(command), "no-such-device")
        rows["--executor"] = executor(command)
    if command != "sample":
        rows["--server"] = elsewhere(at_home(command))
    rows |= OTHERS.get(command, {})
    rows["--help"] = shows(f"{command} --help", lambda run: "Usage:" in run.out, "it prints no usage")
    return rows


def executor(command: str):
    """Who runs the passes of the built-in server; render, view and info say it."""
    says = {"info": lambda run: run.lines()[0]["device"]["passes"],
            "render": lambda run: run.lines()[0]["plan"][-1], "view": lambda run: run.lines()[0]["plan"][-1]}
    line, bad = at_home(command), refuses("--executor nobody", at_home(command), "nobody")
    if command not in says:
        return both(needs("--executor device", "--executor nobody", line, "nobody"), bad)
    return both(*(shows(line.format(f"--executor {who}"), lambda run, who=who: who in says[command](run), f"not those of the {who}")
                  for who in ("device", "host")), bad)


def at_home(command: str) -> str:
    """A line without a server."""
    if command == "report":
        return "report OUT --quick --megapixels 0.001 --images alpha.exr -q {}"
    return LINES[command].replace("--server PLAIN ", "")


def late(command: str):
    """The time of a frame begins with its header, and no machine brings the 16 MB that follow within a millisecond."""
    def check(bench: Bench, _: str) -> None:
        sample = "sample --sequence wide --size 2048x1024 --frames 2 -q"
        ok(bench(sample), sample)
        needs("--frame-timeout 3600", "--frame-timeout 0.001", plural("wide")[command], "deadline passed")(bench, command)
    return both(check, refuses("--frame-timeout 0", plural("film")[command], "--frame-timeout"))


OTHERS = {
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
