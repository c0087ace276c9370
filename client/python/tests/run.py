"""Builds the wheel and the sdist offline, installs the wheel into a bare virtual environment beside Debian's packages, and runs
the tests there: run.py FOLDER_OF_BINARIES [TEST...]"""
import os
import pathlib
import shutil
import subprocess
import sys
import tempfile

HERE = pathlib.Path(__file__).resolve().parent
PACKAGE = HERE.parent


def main(programs: str, tests: list[str]) -> int:
    with tempfile.TemporaryDirectory() as folder:
        scratch = pathlib.Path(folder)
        build = ["/usr/bin/python3", "setup.py", "-q"]
        # The sdist of the tree, and the wheel of the sdist: so both are whole.
        subprocess.run([*build, "egg_info", "--egg-base", scratch, "sdist", "--dist-dir", scratch], cwd=PACKAGE, check=True)
        shutil.unpack_archive(next(scratch.glob("*.tar.gz")), scratch / "sdist")
        sdist = next((scratch / "sdist").iterdir())
        subprocess.run([*build, "bdist_wheel", "--dist-dir", scratch], cwd=sdist, check=True)
        wheel = next(scratch.glob("*.whl"))
        subprocess.run(["/usr/bin/python3", "-m", "venv", "--system-site-packages", scratch / "venv"], check=True)
        python = scratch / "venv/bin/python3"
        subprocess.run([python, "-m", "pip", "install", "-q", "--no-index", "--no-deps", wheel], check=True)
        installed = subprocess.run([python, "-c", "import candela_render as c; print(c.__path__[0])"], cwd=folder, check=True,
                                   stdout=subprocess.PIPE, text=True).stdout.strip()
        assert installed.startswith(folder), installed
        if shutil.which("mypy"):
            subprocess.run(["mypy", "--config-file", PACKAGE / "pyproject.toml", "--cache-dir", scratch / "mypy", installed],
                           check=True)
        environment = {**os.environ, "CANDELA_BIN": str(pathlib.Path(programs).resolve()), "PYTHONDONTWRITEBYTECODE": "1"}
        names = tests or sorted(path.stem for path in HERE.glob("test_*.py"))
        return subprocess.run([python, "-m", "unittest", "-v", *names], cwd=HERE, env=environment).returncode


sys.exit(main(sys.argv[1], sys.argv[2:]))
