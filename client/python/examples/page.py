"""A notebook's page: a frame, its histogram, and exposure over time. page.py PAGE.png"""
import sys

import candela_render as candela
import matplotlib
import numpy

matplotlib.use("Agg")  # a notebook shows it by itself
from matplotlib import pyplot  # noqa: E402

# %% A scene whose lamp is lit after a second.
y, x = numpy.mgrid[0:180, 0:320].astype(numpy.float32) / 180
wall = 0.1 + 0.1 * numpy.sin(9 * x)[..., None] * numpy.float32([1, 0.8, 0.6])
lamp = 40 * numpy.exp(-((x - 0.9) ** 2 + (y - 0.5) ** 2) * 30)[..., None] * numpy.float32([1, 0.9, 0.7])
times = numpy.arange(0, 4, 0.1)

# %% The session exposes it as an eye would.
with candela.Session(curve="agx") as session:
    results = [session(wall + lamp * (t > 1), time=t) for t in times]

# %%
figure, (picture, bars, line) = pyplot.subplots(1, 3, figsize=(12, 3), layout="constrained")
picture.imshow(results[-1][0])
picture.set_axis_off()
first, share = candela.histogram(candela.meter(wall + lamp))
bars.bar(first, share, width=first[1] - first[0], align="edge")
bars.set(xlim=(-6, 7), xlabel="log2 luminance", ylabel="share")
line.plot(times, numpy.log2([info.exposure for _, info in results]), label="exposure")
line.plot(times, numpy.log2([info.target for _, info in results]), ":", label="target")
line.set(xlabel="seconds", ylabel="EV")
line.legend()
figure.savefig(sys.argv[1], dpi=80)
