#!/usr/bin/env python3
"""Compares the spherical harmonics of panoramas with their exact sum: compare_harmonics.py FOLDER_OF_BINARIES [PANORAMA.hdr ...]

Prints the largest error of the 27 coefficients, relative to the largest L_00, of `candela environment --sh` and of Filament's
cmgen. The default panoramas are those of $CANDELA_DATA/hdri. compare.sh installs and builds what this needs, NumPy included.
The exact sum is float64 and shares no code with Candela. It integrates the formulas of docs/environments.md section 3 by a
quadrature that is exact to rounding.
"""
import datetime
import json
import os
import pathlib
import re
import sys
import tempfile

import numpy as np

from compare_tools import CUBE, Failed, lavapipe, run

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1] / "cli/options"))
from exr import write_exr  # noqa: E402

FINE_CUBE = 1024
# cmgen has the Condon-Shortley phase, and its z points ahead.
SIGNS_OF_CMGEN = np.array([1, -1, -1, -1, 1, 1, 1, 1, 1])[:, None]


def read_radiance(path: pathlib.Path) -> np.ndarray:
    """An array of rows, R, G and B, and columns, from a file whose rows are run-length encoded and begin at the top left."""
    data = path.read_bytes()
    at = data.index(b"\n\n") + 2
    end = data.index(b"\n", at)
    words = data[at:end].split()
    if words[0] != b"-Y" or words[2] != b"+X":
        raise Failed(f"{path}: its rows do not begin at the top left")
    rgbe, at = np.zeros((int(words[1]), 4, int(words[3])), np.uint8), end + 1
    for row in rgbe:
        at += 4  # the row's mark and length
        for channel in row:
            x = 0
            while x < channel.size:
                repeated = data[at] > 128
                count, stored = (data[at] - 128, 1) if repeated else (data[at], data[at])
                channel[x:x + count] = np.frombuffer(data, np.uint8, stored, at + 1)
                x, at = x + count, at + 1 + stored
    scale = np.where(rgbe[:, 3] > 0, np.ldexp(1.0, rgbe[:, 3].astype(int) - 136), 0)
    return rgbe[:, :3] * scale[:, None, :]


def nodes(begin: float, end: float, cells: int) -> tuple[np.ndarray, np.ndarray]:
    """Gauss-Legendre nodes and weights in each of the cells."""
    at, weights = np.polynomial.legendre.leggauss(8)
    edges = np.linspace(begin, end, cells + 1)
    middle, half = (edges[1:] + edges[:-1]) / 2, (edges[1:] - edges[:-1]) / 2
    return middle[:, None] + half[:, None] * at, np.abs(half)[:, None] * weights


def exact_harmonics(panorama: np.ndarray) -> np.ndarray:
    """L_lm, nine rows of R, G and B. Every harmonic is a sum of products of a function of a column and one of a row."""
    lon, lon_weights = nodes(-np.pi, np.pi, panorama.shape[2])
    lat, lat_weights = nodes(np.pi / 2, -np.pi / 2, panorama.shape[0])
    lat_weights = lat_weights * np.cos(lat)
    x, z, level = np.sin(lon), -np.cos(lon), np.ones_like(lon)  # on the horizon
    y, out, flat = np.sin(lat), np.cos(lat), np.ones_like(lat)
    one, two, three, four = (np.sqrt(n / (d * np.pi)) for n, d in ((3, 4), (15, 4), (5, 16), (15, 16)))
    terms = [[(np.sqrt(1 / (4 * np.pi)), level, flat)],
             [(one, level, y)], [(one, z, out)], [(one, x, out)],
             [(two, x, out * y)], [(two, z, out * y)], [(3 * three, z * z, out * out), (-three, level, flat)],
             [(two, x * z, out * out)], [(four, x * x, out * out), (-four, level, y * y)]]
    return np.array([sum(factor * np.einsum("y,ycx,x->c", (row * lat_weights).sum(1), panorama, (column * lon_weights).sum(1))
                         for factor, column, row in sums) for sums in terms])


def candela(binaries: pathlib.Path, panorama: pathlib.Path, scratch: pathlib.Path) -> np.ndarray:
    out = scratch / "candela.json"
    run(str(binaries / "candela"), "environment", str(panorama), str(scratch / "cube.ktx2"), "--size", "16", "--sh", str(out),
        "--quiet", VK_ICD_FILENAMES=lavapipe())
    return np.array(json.loads(out.read_text())["radiance"])


def cmgen(panorama: pathlib.Path, cube: int, scratch: pathlib.Path) -> np.ndarray:
    """Without the window against ringing, which changes the coefficients, and without mirroring."""
    out = scratch / "cmgen.txt"
    run("cmgen", "--quiet", "--sh=3", "--sh-window=no", "--no-mirror", f"--size={cube}", f"--sh-output={out}", str(panorama))
    numbers = [re.findall(r"-?\d+\.\d+", line.split("//")[0]) for line in out.read_text().splitlines()]
    return SIGNS_OF_CMGEN * np.array(numbers, float)


def errors(binaries: pathlib.Path, path: pathlib.Path, scratch: pathlib.Path) -> list[float]:
    panorama = read_radiance(path)
    exact = exact_harmonics(panorama)
    halves = panorama.astype(np.float16).astype(float)
    channels = {name: (lambda x, y, c=c: halves[y, c, x]) for c, name in enumerate("RGB")}
    exr = scratch / "panorama.exr"  # of a .hdr, cmgen reads each mantissa m as m + 0.5
    write_exr(exr, panorama.shape[2], panorama.shape[0], {"channels": channels})
    measured = [candela(binaries, path, scratch), cmgen(exr, CUBE, scratch), cmgen(exr, FINE_CUBE, scratch)]
    return [float(np.abs(one - exact).max() / np.abs(exact[0]).max()) for one in measured]


def main() -> None:
    binaries, paths = pathlib.Path(sys.argv[1]), [pathlib.Path(path) for path in sys.argv[2:]]
    if not paths:
        paths = sorted(pathlib.Path(os.environ.get("CANDELA_DATA", ".")).glob("hdri/*_1k.hdr"))
    print(f"{datetime.date.today()}; error relative to L_00\n")
    print(f"| panorama | Candela | cmgen, cube map of {CUBE} | cmgen, {FINE_CUBE} |\n|---|--:|--:|--:|")
    with tempfile.TemporaryDirectory(prefix="candela-harmonics-") as scratch:
        for path in paths:
            found = errors(binaries, path, pathlib.Path(scratch))
            print(f"| {path.stem} | " + " | ".join(f"{error:.1e}" for error in found) + " |")


if __name__ == "__main__":
    main()
