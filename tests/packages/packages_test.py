"""Every program that a script or a test starts, and every module that it imports, comes from a list of packages.

Fails for one that no list brings, as for a row of the tables below that nothing needs. If a program is installed here, the
list's package must also bring the one that it is in. What Debian's smallest root has (essential and required packages, and apt)
needs no list. A program whose name is only known at run time is not seen.
"""
import functools
import pathlib
import re
import shutil
import subprocess
import sys

import other_files
import python_files
import shell

ROOT = pathlib.Path(__file__).resolve().parents[2]
# The lists that are installed before a file is used, by the beginning of its path; the longest counts.
LISTS = {
    "": ("build", "run"),
    ".ci/": ("ci",),
    "deploy/bare-root.sh": ("ci",),
    "deploy/candela-front": ("image", "run"),
    "deploy/Containerfile": ("build", "image", "run", "sbom"),
    "deploy/nightly.sh": ("build", "run", "test", "ci"),
    "deploy/sbom.py": ("build", "sbom"),
    "deploy/test.sh": ("build", "run", "test"),
    "client/python/": ("build", "python"),
    "client/python/examples/": ("build", "python", "test"),  # matplotlib
    "client/python/tests/": ("build", "run", "python", "test"),
    "docs/recipes/": ("build", "run", "test"),
    "shaders/fit/": ("build", "run", "test"),
    "tests/": ("build", "run", "test"),
    "tests/bench/compare": ("build", "run", "test", "compare"),
    "tests/bench/opencv_chain.py": ("build", "run", "test", "compare"),
    "tests/deploy/": ("build", "run", "test", "deploy"),
    "tests/fuzz/": ("build", "run", "test", "fuzz"),
    "tests/net/net.py": ("build", "run", "test", "ci"),  # for --build REV
}
# The package of the lists that brings a program.
PROGRAMS = {
    "catatonit": "catatonit", "cmake": "cmake", "cmgen": "libfilament-tools", "ctest": "cmake", "exrenvmap": "openexr",
    "ffmpeg": "ffmpeg", "mypy": "mypy", "ffprobe": "ffmpeg", "git": "git", "glslangValidator": "glslang-tools", "grpc_python_plugin": "protobuf-compiler-grpc",
    "haproxy": "haproxy", "ip": "iproute2", "mmdebstrap": "mmdebstrap", "nft": "nftables", "nginx": "nginx",
    "oiiotool": "openimageio-tools", "openssl": "openssl", "podman": "podman", "prometheus": "prometheus",
    "promtool": "prometheus", "protoc": "protobuf-compiler", "python3": "python3", "runc": "runc",
    "systemd-analyze": "systemd", "valgrind": "valgrind",
}
# The package of the lists that brings a Python module.
MODULES = {"cv2": "python3-opencv", "grpc": "python3-grpcio", "h2": "python3-h2", "hpack": "python3-h2",
           "google": "python3-protobuf", "kubernetes": "python3-kubernetes", "matplotlib": "python3-matplotlib", "numpy": "python3-numpy",
           "PyOpenColorIO": "python3-pyopencolorio", "setuptools": "python3-setuptools", "yaml": "python3-kubernetes"}
# What these files do without, and say so.
OPTIONAL = {("client/run/film.cc", "ffmpeg"), ("deploy/install-packages.sh", "sudo"),
            ("tests/deploy/kube_test.py", "kubectl"), ("tests/interop/ktx_parse/run.sh", "node"),
            ("tests/interop/ktx_parse/run.sh", "npm"), ("tests/recipes/recipes_test.py", "node")}
# Each of these starts programs a1, a2 ... and none that is called "no".
SAMPLES = [
    (shell.programs, "a1 <"),  # a part of a text, in which the file is named by another part
    (shell.programs, "x=$(a1 \"$(a2 -l)\" | env -u V B=1 a3) || if ! a4; then sudo a5 >f 2>&1 && exec a6; fi # no"),
    (shell.programs, "case $x in no) a1 ;; *) x=(a2 b); \"${x[@]}\" ;; esac; [[ $(a3) == no && -z no ]]; no() { a4; }; no"),
    (shell.programs, "cat <<'END' | a1\nno\nEND\ntrap 'a2 no' EXIT; find . -exec a3 {} +; x=$((1 + $(a4))) a5 'no; no'\n: <(a6)"),
    (lambda text: python_files.programs([text, "run('no')"])[0],
     "import subprocess\ndef own(*words):\n  subprocess.run([str(w) for w in words])\nown('a1', 'no')\nx = ['a2', 'no']\n"
     "subprocess.Popen(x)\nos.system('a3 | a4')\nfor y in ('a5', 'a6'):\n  shutil.which(y)\nown('sh', '-c', 'a7')"),
    (other_files.of_cpp, 'spawn("/usr/bin/a1", {"no"}); std::system("a2 no | a3"); auto n = "a4"; posix_spawnp(&p, n, 0)'),
    (other_files.of_cmake, "add_test(NAME no COMMAND /usr/bin/a1 no)\nCOMMAND x::a2 no\nfind_program(NO a3)\nCOMMAND a4 no)"),
    (other_files.of_containerfile, 'FROM no\nRUN --mount=type=no a1 \\\n  && a2 no\n# RUN no\nHEALTHCHECK CMD ["a3", "no"]'),
]


def packages_of(name: str) -> list[str]:
    lines = (ROOT / f"deploy/packages/{name}.txt").read_text().splitlines()
    return [line for line in lines if line and not line.startswith("#")]


class Installed:
    """Debian's packages on this machine."""

    def __init__(self):
        form = "${Package}\t${Essential}\t${Priority}\t${Provides}\t${Pre-Depends}, ${Depends}\t${db:Status-Status}\n"
        lines = subprocess.run(["dpkg-query", "--show", f"--showformat={form}"], check=True, stdout=subprocess.PIPE,
                               text=True).stdout.splitlines()
        self.needs: dict[str, set[str]] = {}
        self.providers: dict[str, set[str]] = {}
        self.base: set[str] = {"apt"}
        for name, essential, priority, provides, depends, state in (line.split("\t") for line in lines):
            if state != "installed":
                continue
            self.needs.setdefault(name, set()).update(re.findall(r"(?:^|[,|])\s*([a-z0-9][a-z0-9+.-]+)", depends))
            for given in re.findall(r"(?:^|,)\s*([a-z0-9][a-z0-9+.-]+)", provides) + [name]:
                self.providers.setdefault(given, set()).add(name)
            if essential == "yes" or priority == "required":
                self.base.add(name)
        self.base = self.brought_by(self.base)

    @functools.cache
    def _files(self) -> dict[str, set[str]]:
        """The packages by the base names of their programs, and by their Python modules."""
        owners: dict[str, set[str]] = {}
        for listed in pathlib.Path("/var/lib/dpkg/info").glob("*.list"):
            for path in re.findall(r"/s?bin/([^/\n]+)$|/python3/dist-packages/(\w+)(?:\.py)?$", listed.read_text(), re.M):
                owners.setdefault("".join(path), set()).add(listed.stem.split(":")[0])
        return owners

    def brought_by(self, packages: set[str]) -> set[str]:
        """These and all that they depend on."""
        found, new = set(), set(packages)
        while new:
            name = new.pop()
            for package in self.providers.get(name, ()):
                if package not in found:
                    found.add(package)
                    new |= self.needs[package]
        return found

    def owners(self, name: str) -> set[str]:
        """Of an installed program or module; a name of Debian's alternatives is that of its target."""
        path = shutil.which(name)
        return self._files().get(name) or (self._files().get(pathlib.Path(path).resolve().name, set()) if path else set())


def sources() -> dict[str, str]:
    """The text files of the repository by their paths, without what was built."""
    found = {}
    for path in sorted(ROOT.rglob("*")):
        name = path.relative_to(ROOT).as_posix()
        if path.is_file() and not re.match(r"(build|out|\.git)(/|$)", name) and (
                path.suffix in (".sh", ".py", ".cc", ".h", ".cmake", ".txt", "") or name == ".ci/run"):
            found[name] = path.read_text(errors="replace")
    return found


def needs_of(texts: dict[str, str]) -> tuple[dict[str, set[str]], dict[str, set[str]]]:
    """The programs and the modules of each file."""
    programs = {name: set(re.findall(r"\A#!(?:/usr/bin/env |/\w+/(?:bin/)?)(\S+)", text)) for name, text in texts.items()}
    scripts = {name: text for name, text in texts.items() if name.endswith(".py")}
    own = {pathlib.Path(name).stem for name in scripts} | {pathlib.Path(name).parts[0] for name in scripts} | {"candela", "candela_render"}
    for name, found in zip(scripts, python_files.programs(list(scripts.values()))):
        programs[name] |= found
    for name, text in texts.items():
        last = name.rsplit("/", 1)[-1]
        if name in scripts:
            continue
        if programs[name] & {"bash", "sh"}:
            programs[name] |= shell.programs(text)
        elif last.endswith((".cc", ".h")):
            programs[name] |= other_files.of_cpp(text)
        elif last.endswith(".cmake") or last == "CMakeLists.txt":
            programs[name] |= other_files.of_cmake(text)
        elif last == "Containerfile":
            programs[name] |= other_files.of_containerfile(text)
    built = {target for text in texts.values() for target in re.findall(r"\badd_executable\(\s*(\w+)", text)}
    built |= {name.rsplit("/", 1)[-1] for name in texts} | {"candela", "candelad"}
    return {name: found - built for name, found in programs.items()}, {name: python_files.modules(text) - own
                                                                        for name, text in scripts.items()}


def check(kind: str, table: dict[str, str], needs: dict[str, set[str]], installed: Installed) -> list[str]:
    wrong, used = [], set()
    for file, names in needs.items():
        lists = LISTS[max((begin for begin in LISTS if file.startswith(begin)), key=len)]
        for name in sorted(names):
            owners = installed.owners(name)
            if (file, name) in OPTIONAL or owners & installed.base:
                continue
            used.add(name)
            said = f"{file}: {name}"
            if name not in table:
                wrong.append(f"{said} is in no package that a list names; add "
                             f"{' or '.join(sorted(owners)) or 'its package'} to a deploy/packages/*.txt and to {kind} here")
            elif not any(table[name] in packages_of(one) for one in lists):
                wrong.append(f"{said} is in the package {table[name]}, which none of "
                             f"{', '.join(f'packages/{one}.txt' for one in lists)} names")
            elif owners and not owners & installed.brought_by({table[name]}) and installed.providers.get(table[name]):
                wrong.append(f"{said} is in {' or '.join(sorted(owners))}, which {table[name]} does not bring")
    return wrong + [f"{kind} here has {name}, which nothing needs" for name in sorted(table.keys() - used)]


def main() -> None:
    for find, text in SAMPLES:
        found, started = find(text), set(re.findall(r"\ba\d\b", text))
        if not started <= found or "no" in found:
            sys.exit(f"failed: {sorted(found)} is not what this starts:\n{text}")
    if not shutil.which("dpkg-query"):
        print("skipped: packages are Debian's, and there is no dpkg-query here")
        sys.exit(77)
    programs, modules = needs_of(sources())
    installed = Installed()
    wrong = check("PROGRAMS", PROGRAMS, programs, installed) + check("MODULES", MODULES, modules, installed)
    wrong += [f"OPTIONAL here has {name} for {file}, which does not start it" for file, name in sorted(OPTIONAL)
              if name not in programs.get(file, set())]
    count = len({name for found in programs.values() for name in found})
    print("\n".join(wrong) or f"{count} programs, all in packages that are essential or listed")
    sys.exit(bool(wrong))


main()
