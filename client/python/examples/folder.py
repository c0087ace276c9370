"""Arrays to a folder of PNGs, which the server encodes: folder.py FRAMES.npy FOLDER [FRAMES_PER_SECOND]

FRAMES.npy is (n, h, w, 3 or 4) of float16 or float32. One bad frame does not stop the others.
"""
import pathlib
import sys

import candela_render as candela
import numpy


def main(source: str, target: str, rate: float = 25) -> int:
    frames = numpy.load(source, mmap_mode="r")
    folder = pathlib.Path(target)
    folder.mkdir(parents=True, exist_ok=True)
    failed = 0
    with candela.Session(encoding="png", lookahead=4, bad_values="reject") as session:
        for result in session.stream((n / rate, frame) for n, frame in enumerate(frames)):
            if result.error is None:
                (folder / f"{result.sequence:04d}.png").write_bytes(result.image)
            else:
                print(f"frame {result.sequence}: {result.error.message}", file=sys.stderr)
                failed = 1
    return failed


sys.exit(main(sys.argv[1], sys.argv[2], *map(float, sys.argv[3:])))
