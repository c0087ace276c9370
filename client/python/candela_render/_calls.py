"""Single calls: one picture, or a question."""
from __future__ import annotations

from typing import Any, Callable, TypeVar

import numpy
from google.protobuf import wrappers_pb2

from . import render_pb2 as pb
from ._channel import Connection, Security, Servers, connect
from ._error import Error, protocol_error
from ._frame import Frame, View, make_frame
from ._messages import fill, settings_message
from ._retry import retry
from ._wire import Array, ImageReader, image_reader
from .settings import ExposureState, Settings

SERVICE = "/candela.v1.RenderService/"
BAND_FIELD = 2
ANSWER_LIMIT = 10.0  # s; of calls that render nothing
T = TypeVar("T")


def ask(server: Servers, security: Security, limit: float, call: Callable[[Connection], T]) -> T:
    connections = connect(server, security)
    try:
        return retry(connections, limit, call)
    finally:
        for connection in connections:
            connection.close()


def _request(start: pb.RenderStart, frame: Frame) -> Any:
    yield pb.RenderRequest(start=start).SerializeToString()
    yield from frame.bands(BAND_FIELD)


def _start(frame: Frame, settings: Settings | None, changes: dict[str, Any], previous: object, **rest: Any) -> pb.RenderStart:
    start = pb.RenderStart(settings=settings_message(settings, changes), frame=frame.header, **rest)
    if previous is not None:
        fill(start.previous, previous, "previous.")
    return start


def render(frame: Array | View, *, settings: Settings | None = None, server: Servers = None, security: Security = Security(),
           exposure: float | None = None, previous: ExposureState | dict[str, object] | None = None, sequence: int = 0,
           verify: bool = False, timeout: float | None = None, retry_limit: float = 30,
           **changes: Any) -> tuple[Array, pb.ResultHeader]:
    """Renders one frame for itself.

    frame: (h, w, 3 or 4) float16 or float32, scene-linear, alpha associated; or a View.
    server, security, settings, changes: as for Session. exposure: as for a session's frame.
    previous: the exposure before, and the seconds since then, where exposure starts to adapt from.
    sequence: seeds the dither. verify: compare with the float64 reference; info.verify has the errors.
    timeout: seconds for one call. retry_limit: seconds for which a full server is asked again.

    Returns the image, (h, w, 4) of uint8, uint16 or float16, and its info. Raises Error.
    """
    made = make_frame(frame, copy=False, exposure=exposure, sequence=sequence)
    start = _start(made, settings, changes, previous, verify=verify)

    def once(server: Connection) -> tuple[Array, pb.ResultHeader]:
        call = server.channel.stream_stream(SERVICE + "Render", response_deserializer=pb.RenderResponse.FromString)
        header: pb.ResultHeader | None = None
        image: ImageReader | None = None
        whole = False
        for response in call(_request(start, made), metadata=server.begin(), timeout=timeout):
            part = response.WhichOneof("part")
            if part == "header" and header is None:
                header = response.header
                image = image_reader(header)
            elif part == "band" and image is not None and not whole:
                whole = image.take(response.band.first_row, memoryview(response.band.pixels))
            else:
                raise protocol_error(f"an unexpected {part}")
        if header is None or image is None or not whole:
            raise protocol_error("it ended before the image was whole")
        return image.image, header

    return ask(server, security, retry_limit, once)


def meter(frame: Array | View, *, settings: Settings | None = None, server: Servers = None, security: Security = Security(),
          exposure: float | None = None, previous: ExposureState | dict[str, object] | None = None,
          timeout: float | None = None, retry_limit: float = 30, **changes: Any) -> pb.MeterResponse:
    """Meters one frame: exposure, target, statistics and the histogram of its log2 luminance. Arguments as for render()."""
    made = make_frame(frame, copy=False, exposure=exposure)
    start = _start(made, settings, changes, previous)

    def once(server: Connection) -> pb.MeterResponse:
        call = server.channel.stream_unary(SERVICE + "Meter", response_deserializer=pb.MeterResponse.FromString)
        answer: pb.MeterResponse = call(_request(start, made), metadata=server.begin(), timeout=timeout)
        return answer

    return ask(server, security, retry_limit, once)


def histogram(metered: pb.MeterResponse) -> tuple[Array, Array]:
    """Of meter()'s answer: the log2 luminance at which each bin begins, and its share of the weight, of which the sum is 1."""
    weights = numpy.array(metered.histogram, dtype=numpy.float64)
    first = metered.histogram_first_ev + numpy.arange(len(weights)) / max(1, metered.histogram_bins_per_ev)
    return first, weights / max(1.0, float(weights.sum()))


def unary(server: Connection, method: str, request: Any, answer: Any, timeout: float | None = ANSWER_LIMIT) -> Any:
    call = server.channel.unary_unary(method, request_serializer=type(request).SerializeToString,
                                      response_deserializer=answer.FromString)
    return call(request, metadata=server.begin(), timeout=timeout)


def info(server: Servers = None, *, security: Security = Security(), retry_limit: float = 30) -> pb.GetServerInfoResponse:
    """The server's version, device, tiers, limits and settings. Raises Error."""
    def once(one: Connection) -> pb.GetServerInfoResponse:
        answer: pb.GetServerInfoResponse = unary(one, SERVICE + "GetServerInfo", pb.GetServerInfoRequest(),
                                                 pb.GetServerInfoResponse)
        return answer

    return ask(server, security, retry_limit, once)


def health(server: Servers = None, *, security: Security = Security()) -> bool:
    """Whether the server takes work: False while it starts or drains. Raises Error if it cannot be reached."""
    def once(one: Connection) -> bool:
        # These wrappers have the same encoding as grpc.health.v1's request and response.
        status = unary(one, "/grpc.health.v1.Health/Check", wrappers_pb2.StringValue(), wrappers_pb2.Int32Value)
        return bool(status.value == 1)

    try:
        return ask(server, security, 0, once)
    except Error as error:
        if error.code == "UNAVAILABLE" and error.reached:
            return False
        raise
