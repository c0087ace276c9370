"""Makes the stubs when the package is built. In Candela's tree render.proto is at its place; an sdist brings a copy."""
import pathlib
import re
import shutil
import sys

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

HERE = pathlib.Path(__file__).resolve().parent
TREE = HERE.parent.parent
PROTO = "candela/v1/render.proto"
sys.path.insert(0, str(HERE))
IN_TREE = (TREE / "proto" / PROTO).exists()


class Build(build_py):
    def run(self):
        from generate import generate

        super().run()
        generate(TREE / "proto" if IN_TREE else HERE / "proto", pathlib.Path(self.build_lib) / "candela_render")


class Sdist(sdist):
    def make_release_tree(self, base_dir, files):
        super().make_release_tree(base_dir, files)
        if IN_TREE:
            target = pathlib.Path(base_dir) / "proto" / PROTO
            target.parent.mkdir(parents=True)
            shutil.copy(TREE / "proto" / PROTO, target)
            (pathlib.Path(base_dir) / "VERSION").write_text(version())


def version():
    if not IN_TREE:
        return (HERE / "VERSION").read_text()
    return re.search(r"project\(\w+[^)]*VERSION ([\d.]+)", (TREE / "CMakeLists.txt").read_text()).group(1)


setup(version=version(), cmdclass={"build_py": Build, "sdist": Sdist})
