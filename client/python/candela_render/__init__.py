"""HDR frames in, tone-mapped images out, as numpy arrays: the client of Candela.

    import candela_render as candela

    image, info = candela.render(frame, curve="agx")            # one frame for itself

    with candela.Session() as session:                          # frames over time: exposure adapts
        for t, frame in frames:
            image, info = session(frame, time=t, curve="agx")
            print(info.exposure, info.statistics.mean_log2_luminance)

A frame is an array (h, w, 3 or 4) of float16 or float32, scene-linear, rows from top to bottom, any strides; a fourth component is
alpha, with which the colour is associated. An image is (h, w, 4) of uint8 (sRGB), or of uint16 or float16 if the setting
output_format says "rgba16" or "rgba16f"; uint16 with the transfers "pq" and "hlg". With gain_map_peak_nits the fourth component is
a gain map's code in place of alpha.

Settings are given by name, as curve="agx", bloom={"intensity": 0.1} or exposure={"mode": "manual", "manual_ev": -1}, or as a
Settings; see help(candela_render.Settings). Everything fails with Error, which has a code, a message that names field, value and
limit, and a retry delay.

Without an address, candelad is started, as CANDELAD or PATH have it; else give "HOST:PORT", "unix:PATH" or a list of them.
"""
from . import _fork  # isort: skip  # before grpc
from ._aio import AsyncSession
from ._baked_view import BakedView, bake_transform, bake_view
from ._calls import health, histogram, info, meter, render
from ._channel import Security
from ._core import Stats
from ._environment import Bake, Environment
from ._error import Error
from ._frame import View
from ._result import Result
from ._session import Session
from .settings import Camera, Settings, Sphere

__all__ = ["AsyncSession", "Bake", "BakedView", "Camera", "Environment", "Error", "Result", "Security", "Session", "Settings", "Sphere",
           "Stats", "View", "bake_transform", "bake_view", "health", "histogram", "info", "meter", "render"]
