"""A simulator at 30 Hz: its camera drives out of a tunnel, and the log has the exposure of each frame.

simulator.py LOG.csv [SECONDS]
"""
import csv
import sys
import time

import candela_render as candela
import numpy

RATE = 30


def camera(t: float, height: int = 240, width: int = 320) -> numpy.ndarray:
    """The road's light at a time: 200 times brighter outside. Any simulator's linear image does."""
    y, x = numpy.mgrid[0:height, 0:width].astype(numpy.float32)
    outside = numpy.hypot(x - width / 2, y - height / 2) < 20 + 120 * t
    light = numpy.where(outside, 10.0, 0.05) * (1 + 0.2 * numpy.sin(x / 9 + 20 * t))
    return numpy.stack([light, light * 0.95, light * 0.8], axis=-1).astype(numpy.float16)


def main(log_file: str, seconds: float = 2) -> None:
    with candela.Session() as session, open(log_file, "w", newline="") as file:
        log = csv.writer(file)
        log.writerow(["time_s", "exposure_ev", "target_ev", "late_ms"])
        start = time.monotonic()
        for n in range(round(seconds * RATE)):
            t = n / RATE  # the simulation's time: exposure does not depend on how fast this computer is
            image, info = session(camera(t), time=t, curve="agx")
            late = time.monotonic() - start - (n + 1) / RATE
            log.writerow([f"{t:.4f}", *numpy.log2([info.exposure, info.target]).round(3), f"{max(0, late) * 1000:.1f}"])
            time.sleep(max(0, -late))


main(sys.argv[1], *map(float, sys.argv[2:]))
