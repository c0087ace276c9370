"""What shows that an option works: functions that make a check, which is a function of the workbench that raises Wrong.

A line of options is written as on the command line. `changes` and `each_word` compare results, that is images and numbers: an
option that is ignored fails.
"""
import json
import shutil
import struct

from bench import Bench, Run

SERVERS = ("render", "contact", "stream", "meter", "view", "environment", "report", "bench", "info")  # that can also render without a daemon
GUARDS = {"--tls-ca": "ca.pem", "--tls-cert": "client.pem", "--tls-key": "client.key", "--tls-name": "candela.test",
          "--token-file": "tokens"}
FFMPEG = shutil.which("ffmpeg")


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
         "contact": "contact scene.exr OUT/o.png --json - -q --server PLAIN {}",
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
        lines = [said for said in run.err.strip().splitlines() if said != "candela: error: 1 of 1 images failed"]
        hold(run.code in (1, 2, 3, 4, 5) and len(lines) == 1,
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


def to(server: str, command: str) -> str:
    """The command's line with that server."""
    if command in ("report", "info"):
        return f"{at_home(command)} --server {server}"
    return LINES[command].replace("PLAIN", server)


def guarded(option: str):
    """With every secret a guarded server answers; without this one it does not."""
    def check(bench: Bench, command: str) -> None:
        line = to("GUARDED", command)
        everything = " ".join(f"{name} {value}" for name, value in GUARDS.items())
        if command != "report":  # it measures for long; --tls-ca's own entry runs it
            ok(bench(line.format(everything)), line.format(everything))
        rest = " ".join(f"{name} {value}" for name, value in GUARDS.items() if name != option)
        hold(bench(line.format(rest)).code in ((1, 2) if command == "health" else (2, 4)),
             f"a guarded server answers without {option}")
    return check


def public(bench: Bench, command: str) -> None:
    """--tls trusts the system's CAs, so only a server with their certificate answers."""
    line = to("PUBLIC", command)
    run = bench(line.format("--tls"))
    hold(run.code == (1 if command == "health" else 4) and "certificate" in run.err,
         f"--tls does not check the certificate: {run.err.strip()}")
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
OUTPUTS = {"render": "OUT/o.png", "contact": "OUT/o.png", "stream": "OUT/%d.png", "meter": "", "view": "OUT/o.png --size 48x32",
           "environment": "OUT/o.ktx2"}


def one_file(command: str, name: str) -> str:
    number = ".0001" if command == "stream" else ""
    return f"{command} {name}{number}.exr {OUTPUTS[command]} --json - -q --server PLAIN {{}}"


def alpha(command: str):
    if command == "meter":
        return changes("--alpha ignore", line=one_file("meter", "alpha"))
    return each_word("--alpha", line=one_file(command, "alpha"), but=("over",))  # over black is what ignore shows


def encodings(bench: Bench, _: str) -> None:
    """PNG and JPEG come from the server, in files of the same names as the command's own."""
    for word, ending in (("raw", "png"), ("png", "png"), ("jpeg", "jpg")):
        line = f"stream film OUT/%04d.{ending} --json - -q --server PLAIN --encoding {word}"
        run = ok(bench(line), line)
        by_server = run.lines()[0].get("encoding")
        hold(by_server in (word, None), f"--encoding {word} was encoded as {by_server}")
        hold(len(run.files) == 6, f"--encoding {word} wrote {sorted(run.files)}")


def pipes(bench: Bench, _: str) -> None:
    """Each kind of frames on standard output begins as it should."""
    for word, begin in (("y4m", "YUV4MPEG2 W48 H32 F24:1 Ip A1:1 C420mpeg2 "), ("y4m444", "YUV4MPEG2 W48 H32 F24:1 Ip A1:1 C444 "),
                        ("pam", "P7\nWIDTH 48\n")):
        line = f"stream film - -q --server PLAIN --pipe {word}"
        hold(ok(bench(line), line).out.startswith(begin), f"--pipe {word} does not begin as {begin}")


def pipe_matrices(bench: Bench, _: str) -> None:
    """Each matrix makes other planes; a small picture has BT.601's without the option."""
    outputs = []
    for option in ("--pipe-matrix bt709", "--pipe-matrix bt2020", "--pipe-matrix bt601", ""):
        line = f"stream film - -q --server PLAIN {option}"
        outputs.append(ok(bench(line), line).out)
    hold(len(set(outputs)) == 3 and outputs[2] == outputs[3], "--pipe-matrix does not choose the matrix")


def sizes(run: Run) -> set:
    """Width, height and pixel aspect of the PNG files that it wrote."""
    def of(png: bytes) -> tuple:
        at = png.find(b"pHYs", 0, 200)
        across, down = struct.unpack(">II", png[at + 4:at + 12]) if at > 0 else (1, 1)
        return (*struct.unpack(">II", png[16:24]), down / across)
    return {of(data) for name, data in run.files.items() if name.endswith(".png")}


def films(bench: Bench, _: str) -> None:
    """Each codec makes a film that names it; without ffmpeg each says what to install."""
    for word, ending, names in (("h264", "mp4", b"avc1"), ("hevc", "mp4", b"hvc1"), ("av1", "webm", b"V_AV1"), ("prores", "mov", b"apch")):
        line = f"stream film OUT/o.{ending} --fps 24 --json - -q --server PLAIN --codec {word}"
        if FFMPEG:
            hold(names in ok(bench(line), line).files[f"o.{ending}"], f"--codec {word} made something else")
        else:
            refuses(line, words="apt-get install ffmpeg")(bench, "stream")


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


def device(command: str):
    """Without a Vulkan device there are no environments."""
    named = needs("--device llvmpipe", "--device no-such-device", at_home(command), "no-such-device")
    if command in ("view", "environment"):
        return both(named, refuses("--device host", at_home(command), "only that bakes environments"))
    return both(named, needs("--device host", "--device no-such-device", at_home(command), "no-such-device"))


def executor(command: str):
    """Who runs the passes of the built-in server; render, view and info say it."""
    says = {"info": lambda run: run.lines()[0]["device"]["passes"],
            **{name: lambda run: run.lines()[0]["plan"][-1] for name in ("render", "contact", "view")}}
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
