#!/usr/bin/env python3
"""Shows that a change of the code changes no result: renders everything in every way and compares.

    net.py BIN --against OTHER      compares the programs in the folder BIN with those in OTHER
    net.py BIN --build REV          builds revision REV in a scratch folder first and compares with that
    net.py BIN                      makes only what has to be refused, and compares its exits with exits.json
    net.py BIN --record             writes exits.json from BIN
With --small only the small set is compared; with --only TEXT the cases with TEXT in their name. Exits with 0 if nothing
differs, with 1 if something does, and with 77 if it cannot run here. Real images come from CANDELA_DATA (default:
../shared/data).
See README.md beside this file.
"""
import argparse
import concurrent.futures
import json
import os
import pathlib
import re
import shutil
import subprocess
import sys
import tempfile

sys.dont_write_bytecode = True

try:
    import cases
    import environments
    import refusals
    import scenes
    import wire
    from outcome import Outcome, digest
    from png import comparable
except ModuleNotFoundError as missing:
    print(f"SKIPPED: this Python has no {missing.name}; install python3-grpcio and run it with /usr/bin/python3")
    sys.exit(77)

HERE = pathlib.Path(__file__).resolve().parent
ROOT = HERE.parents[1]
EXITS = HERE / "exits.json"
SKIPPED = 77
SECONDS = 300  # one case at most
PROGRESS = 100  # cases between two lines that say how far it is


def content(path: pathlib.Path) -> bytes:
    """What counts of a file: not the version that wrote a KTX2 file, nor how a PNG is filtered and deflated."""
    data = path.read_bytes()
    if path.suffix == ".ktx2":
        return re.sub(rb"KTXwriter\0candela [^\0]*", b"KTXwriter", data, count=1)
    return comparable(data)


class Programs:
    """The programs of one build, with a running candelad."""

    def __init__(self, folder: pathlib.Path, scratch: pathlib.Path, scene_folder: pathlib.Path, data: pathlib.Path):
        self.folder, self.scratch = folder.resolve(), scratch
        self.places = {"{scenes}": str(scene_folder), "{data}": str(data), "{server}": f"unix:{scratch}/socket"}
        keys = scratch / "keys"
        keys.write_text(wire.KEY.hex() + "\n")
        keys.chmod(0o600)
        self.environment = {name: value for name, value in os.environ.items() if not name.startswith("CANDELA_")}
        self.environment["XDG_CACHE_HOME"] = str(scratch)
        # Other builds may be older than the first name.
        self.environment |= {"CANDELA_EXECUTOR": "device", "CANDELA_PASSES": "device"}
        self.daemon = subprocess.Popen(
            [self.folder / "candelad", "--listen", self.places["{server}"], "--resume-keys", keys, "--log-level",
             "off"],
            stdout=subprocess.PIPE, text=True, env=self.environment)
        if not self.daemon.stdout.readline().startswith("listening on"):
            raise SystemExit(f"{self.folder}/candelad does not start")
        self.client = wire.Client(self.places["{server}"], scene_folder)

    def close(self) -> None:
        self.daemon.terminate()
        self.daemon.wait()

    def run(self, case: cases.Case) -> Outcome:
        try:
            return self.outcome(case)
        except Exception as error:  # a case that fails in the script differs from the others
            print(f"{case.name}: {error!r}", file=sys.stderr)
            return Outcome(type(error).__name__)

    def outcome(self, case: cases.Case) -> Outcome:
        if case.call:
            return case.call(self.client)
        with tempfile.TemporaryDirectory(dir=self.scratch) as out:
            places = self.places | {"{out}": out}
            arguments = []
            for argument in case.arguments:
                for name, place in places.items():
                    argument = argument.replace(name, place)
                arguments.append(argument)
            done = subprocess.run([self.folder / case.program, *arguments], stdout=subprocess.PIPE,
                                  stderr=subprocess.DEVNULL,
                                  stdin=subprocess.DEVNULL, timeout=SECONDS, env=self.environment, cwd=out,
                                  check=False)
            if case.only_exit:
                return Outcome(str(done.returncode))
            files = sorted(path for path in pathlib.Path(out).rglob("*") if path.is_file())
            whole = "".join(f"{path.relative_to(out)} {digest(content(path))}\n" for path in files)
            json_text = done.stdout.decode() if "--json" in arguments else ""
            return Outcome.of_json(str(done.returncode), digest(whole.encode()) if files else "", json_text)


def all_cases(scene_names: list[str], data: pathlib.Path, client: wire.Client, options) -> list[cases.Case]:
    """Without another build, those that exits.json has; to record it, those that need no real image."""
    out = [*cases.other_cases(), *cases.session_cases(), *wire.token_cases(client.v1),
           *refusals.render_cases(client.v1), *refusals.session_cases(client.v1), *environments.command_cases(),
           *environments.call_cases(client.v1), *environments.refusal_cases(client.v1),
           *cases.scene_cases(scene_names)]
    if options.compares and not options.small and data.is_dir():
        out += [*environments.data_cases(), *cases.data_cases(data)]
    names = [case.name for case in out]
    assert len(set(names)) == len(names), sorted({name for name in names if names.count(name) > 1})
    if not options.compares and not options.record:
        exits = recorded_exits()
        out = [case for case in out if case.name in exits]
    return [case for case in out if (case.small or not options.small) and options.only in case.name]


def run_all(folder: pathlib.Path, options, scratch: pathlib.Path, scene_folder: pathlib.Path, scene_names: list[str],
            data: pathlib.Path) -> dict[str, tuple[cases.Case, Outcome]]:
    """Every case's outcome by its name."""
    scratch.mkdir()
    programs = Programs(folder, scratch, scene_folder, data)
    try:
        chosen = all_cases(scene_names, data, programs.client, options)
        with concurrent.futures.ThreadPoolExecutor(options.jobs) as pool:
            outcomes = []
            for outcome in pool.map(programs.run, chosen):
                outcomes.append(outcome)
                if len(outcomes) % PROGRESS == 0:
                    print(f"{len(outcomes)} of {len(chosen)} cases of {folder}", file=sys.stderr, flush=True)
        if programs.daemon.poll() is not None:
            raise SystemExit(f"{folder}/candelad ended with {programs.daemon.returncode}")
        return {case.name: (case, outcome) for case, outcome in zip(chosen, outcomes)}
    finally:
        programs.close()


def recorded_exits() -> dict[str, str]:
    """The exit code or the gRPC status of each case of which nothing else counts, by its name."""
    return json.loads(EXITS.read_text(encoding="utf-8"))


def write_exits(results) -> int:
    exits = {name: outcome.exit for name, (case, outcome) in results.items()
             if case.only_exit or outcome.exit.split()[-1] not in ("0", "OK")}
    EXITS.write_text(json.dumps(exits, indent=0) + "\n", encoding="utf-8")
    return len(exits)


def compare(expected: dict[str, list[str]]) -> int:
    """Prints what differs; `expected` has the differing parts of each case by its name."""
    different = {name: parts for name, parts in expected.items() if parts}
    for name, parts in different.items():
        print(f"DIFFERS  {name}: {', '.join(parts)}")
    print(f"{len(expected) - len(different)} cases same, {len(different)} differ")
    return 1 if different or not expected else 0


def build(revision: str, scratch: pathlib.Path) -> pathlib.Path:
    """The programs of another revision, built in a work tree in `scratch`."""
    tree = scratch / "before"
    subprocess.run(["git", "-C", ROOT, "worktree", "add", "--detach", tree, revision], check=True)
    try:
        subprocess.run([tree / "deploy/build.sh", "release", "-DCANDELA_TESTS=OFF"], check=True)
        shutil.copytree(tree / "build/release/bin", scratch / "before-bin")
    finally:
        subprocess.run(["git", "-C", ROOT, "worktree", "remove", "--force", tree], check=False)
    return scratch / "before-bin"


def parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("bin", type=pathlib.Path, help="folder of candela and candelad")
    parser.add_argument("--against", type=pathlib.Path, metavar="OTHER",
                        help="folder of the programs to compare with")
    parser.add_argument("--build", metavar="REV", help="revision to build and compare with")
    parser.add_argument("--record", action="store_true", help="write exits.json")
    parser.add_argument("--small", action="store_true", help="only the small set")
    parser.add_argument("--only", default="", metavar="TEXT", help="only the cases with TEXT in their name")
    parser.add_argument("--jobs", type=int, default=os.cpu_count(), help="cases at a time")
    options = parser.parse_args()
    options.compares = bool(options.against or options.build)
    if options.record and (options.small or options.only or options.compares):
        parser.error("--record goes with no other option")
    if options.small and not options.compares:
        parser.error("--small goes with --against and --build")
    return options


def main() -> int:
    options = parse()
    os.environ.pop("OCIO", None)  # it would choose a view for every picture
    data = pathlib.Path(os.environ.get("CANDELA_DATA") or ROOT.parent / "shared/data")
    if lacking := [tool for tool in ("protoc", "grpc_python_plugin") if not shutil.which(tool)]:
        print(f"SKIPPED: {' and '.join(lacking)} not found; install protobuf-compiler and protobuf-compiler-grpc")
        return SKIPPED
    if options.compares and not options.small and not data.is_dir():
        print(f"no real images: {data} is not there; set CANDELA_DATA")
    with tempfile.TemporaryDirectory(prefix="candela-net-") as folder:
        scratch = pathlib.Path(folder)
        (scratch / "scenes").mkdir()
        (scratch / "stubs").mkdir()
        wire.make_stubs(scratch / "stubs")
        before_bin = options.against or (build(options.build, scratch) if options.build else None)
        scene_names = scenes.make(before_bin / "candela" if before_bin else options.bin / "candela",
                                  scratch / "scenes", options.small or not (options.compares or options.record))

        def run(bin_folder: pathlib.Path, name: str):
            return run_all(bin_folder, options, scratch / name, scratch / "scenes", scene_names, data)

        results = run(options.bin, "now")
        if options.record:
            print(f"{write_exits(results)} exits recorded")
            return 0
        if before_bin:
            before = run(before_bin, "then")
            return compare({name: outcome.differs_from(before[name][1]) for name, (_, outcome) in results.items()})
        exits = {name: code for name, code in recorded_exits().items() if options.only in name}
        now = {name: results[name][1].exit if name in results else "no case any more" for name in exits}
        return compare({name: [] if now[name] == code else [f"exit was {code}, is {now[name]}"]
                        for name, code in exits.items()})


if __name__ == "__main__":
    sys.exit(main())
