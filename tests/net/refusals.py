"""Calls that the command cannot make: settings and messages that are refused, and settings without an option."""
import struct

from cases import Case
from outcome import Outcome
from wire import Client, outcome_of


def settings_refused(v1) -> dict:
    """Settings that no server takes."""
    exposure, metering, bloom = v1.Exposure, v1.Metering, v1.Bloom
    nan = float("nan")

    def metered(**fields):
        return v1.Settings(exposure=exposure(metering=metering(**fields)))

    def adapted(**fields):
        return v1.Settings(exposure=exposure(adaptation=v1.Adaptation(**fields)))

    def tabled(**fields):
        return v1.Settings(curve=v1.TONE_CURVE_TABLE, table=v1.ColorTable(**fields))

    out = {}
    for name, values in {"manual_ev": (41, -41, nan), "compensation_ev": (41, nan), "key": (0, 2e6, nan),
                         "min_exposure": (0, 2e12), "max_exposure": (0, 2e12, 0.001), "mode": (99,)}.items():
        out |= {f"{name} {value}": v1.Settings(exposure=exposure(**{name: value})) for value in values}
    for name, values in {"intensity": (-1, 10.5, nan), "threshold": (-1, 2e9), "softness": (-0.1, 1.1),
                         "levels": (0, 17), "kind": (99,)}.items():
        out |= {f"bloom {name} {value}": v1.Settings(bloom=bloom(**{name: value})) for value in values}
    for name, values in {"curve": (99,), "prescale": (0, 2e12, nan), "transfer": (99,), "output_format": (99,),
                         "bad_values": (99,), "tier": ("fast",), "curve_white": (0, 2e9, nan),
                         "input_primaries": (99,), "max_error_codes": (-1, 256)}.items():
        out |= {f"{name} {value}": v1.Settings(**{name: value}) for value in values}
    out |= {"conserve above 1": v1.Settings(bloom=bloom(kind=bloom.KIND_CONSERVE, intensity=1.5)),
            "percentiles alike": metered(percentile_low=50, percentile_high=50),
            "percentile above 100": metered(percentile_high=101),
            "percentile below 0": metered(percentile_low=-1), "statistic 99": metered(statistic=99),
            "weights 99": metered(weights=99),
            "spot without rectangle": metered(weights=metering.WEIGHTS_SPOT),
            "empty spot": metered(weights=metering.WEIGHTS_SPOT, spot=v1.Rectangle(x0=4, x1=4, y1=4)),
            "spot outside": metered(weights=metering.WEIGHTS_SPOT, spot=v1.Rectangle(x0=900, x1=904, y1=4)),
            "speed_up -1": adapted(speed_up=-1), "speed_down 1001": adapted(speed_down=1001),
            "domain 99": adapted(domain=99),
            "tier and promise": v1.Settings(tier="draft", max_error_codes=5),
            "no table": v1.Settings(curve=v1.TONE_CURVE_TABLE),
            "table without its curve": v1.Settings(table=v1.ColorTable(size=2, values=bytes(48))),
            "table of 1": tabled(size=1, values=bytes(6)), "table one byte short": tabled(size=2, values=bytes(47)),
            **{f"table of {n} with {extra:+d} bytes": tabled(size=n, values=bytes(6 * n ** 3 + extra))
               for n in (3, 17, 65) for extra in (-2, -1, 1)},
            "table end 0": tabled(size=2, end=0, values=bytes(48)),
            "singular primaries": v1.Settings(input_chromaticities=v1.Chromaticities(
                red_x=0.3, red_y=0.3, green_x=0.3, green_y=0.3)),
            "primaries twice": v1.Settings(input_primaries=v1.PRIMARIES_XYZ,
                                           input_chromaticities=v1.Chromaticities(red_x=0.6))}
    return out


def table(v1, axes, **fields):
    """A tone curve by a small table in which every point differs."""
    size = 5
    points = [(i % size, (i // size + i) % size, i // size ** 2) for i in range(size ** 3)]
    values = b"".join(struct.pack("<3H", *(65535 * v // (size - 1) for v in point)) for point in points)
    return v1.Settings(curve=v1.TONE_CURVE_TABLE, table=v1.ColorTable(size=size, axes=axes, values=values, **fields))


def render_cases(v1) -> list[Case]:
    def case(name, settings=None, **start):
        return Case(f"Render: {name}", True, call=lambda client: client.render(settings or v1.Settings(), **start))

    refused = [case(name, settings) for name, settings in settings_refused(v1).items()]
    frames = {"width 0": {"width": 0}, "width 20000": {"width": 20000}, "no format": {"format": 0},
              "format 99": {"format": 99}, "short stride": {"row_stride_bytes": 8},
              "long stride": {"row_stride_bytes": 9000}, "wrong total": {"total_bytes": 5},
              "another height": {"height": 53}, "more rows": {"height": 55}}
    refused += [case(f"frame with {name}", frame=frame) for name, frame in frames.items()]
    refused += [case("error map without verify", error_map=True),
                case("previous exposure 0", previous=v1.ExposureState(exposure=0)),
                case("elapsed -1", previous=v1.ExposureState(exposure=1, elapsed_seconds=-1))]
    rendered = [case("default"), case("RGBA16F", v1.Settings(output_format=v1.OUTPUT_FORMAT_RGBA16F)),
                case("table on ACES axes", table(v1, v1.ColorTable.AXES_ACES)),
                case("table on Rec.709 axes", table(v1, v1.ColorTable.AXES_REC709, end=8)),
                case("table on AP1 axes", table(v1, v1.ColorTable.AXES_AP1, end=64)),
                case("error map", v1.Settings(), verify=True, error_map=True),
                case("previous exposure", v1.Settings(), previous=v1.ExposureState(exposure=3, elapsed_seconds=0.25)),
                case("half as wide", v1.Settings(), frame={"width": 48, "height": 108}),
                case("dithered, frame 9", v1.Settings(dither=True), frame={"sequence": 9})]
    for pixel_format, bytes_of in ((v1.PIXEL_FORMAT_RGBA16F, 8), (v1.PIXEL_FORMAT_RGB9E5, 4)):
        # The float pixels' bytes, taken as another format: any bits at all.
        size = {"width": 96, "height": 54 * 16 // bytes_of, "format": pixel_format}
        rendered.append(case(f"any bits as format {pixel_format}", v1.Settings(), frame=size))
    return refused + rendered


def sessions_refused(v1) -> dict:
    """Open messages that the server refuses."""
    out = {f"session {name!r}": {"session": name} for name in ("", "a/b", "x" * 65)}
    out |= {"lookahead 17": {"lookahead": 17}, "cuts -1": {"cut_threshold_ev": -1},
            "cuts 17": {"cut_threshold_ev": 17},
            "jpeg quality 101": {"encoding": v1.ENCODING_JPEG, "jpeg_quality": 101}, "encoding 99": {"encoding": 99},
            "jpeg of 16 bits": {"encoding": v1.ENCODING_JPEG,
                                "settings": v1.Settings(output_format=v1.OUTPUT_FORMAT_RGBA16)},
            "png of halves": {"encoding": v1.ENCODING_PNG,
                              "settings": v1.Settings(output_format=v1.OUTPUT_FORMAT_RGBA16F)},
            "no such tier": {"settings": v1.Settings(tier="fast")},
            "a token that is none": {"resume_token": b"token"},
            "a token of 2000 bytes": {"resume_token": bytes(2000)}}
    return out


def status_first(status: str, results) -> Outcome:
    """Only the status of a refusal, because the number of results before it varies."""
    return outcome_of(status, results) if status == "OK" else Outcome(status)


def changed_token(client: Client, change: str) -> Outcome:
    """Resumes a session after a change of its token, or of the session that the token belongs to."""
    v1, name = client.v1, f"net-changed-{change.replace(' ', '-')}"
    status, results = client.session(range(3), v1.Settings(), session=name)
    if status != "OK":
        return outcome_of(status, results)
    token, settings = results[-1][2], v1.Settings()
    if change == "a bit":
        token = token[:20] + bytes([token[20] ^ 1]) + token[21:]
    elif change == "its length":
        token = token[:-1]
    elif change == "settings":
        settings = v1.Settings(dither=True)
    elif change == "session":
        name += "-other"
    return status_first(*client.session(range(3, 5), settings, session=name, resume_token=token))


def sequence_of(client: Client, name: str, *headers: dict) -> Outcome:
    """A session with frames at these headers."""
    v1, messages = client.v1, []
    for i, header in enumerate(headers):
        messages += client.frame_messages(client.frames[i], v1.StreamRequest, **({"sequence": i} | header))
    return status_first(*client.stream(messages, session=f"net-{name.replace(' ', '-')}"))


def early_change(client: Client, changes: int, first: int) -> Outcome:
    v1 = client.v1
    messages = client.frame_messages(client.frames[0], v1.StreamRequest, 0)
    messages += [v1.StreamRequest(change=v1.SettingsChange(from_sequence=first + i, settings=v1.Settings()))
                 for i in range(changes)]
    return status_first(*client.stream(messages, session=f"net-changes-{changes}-{first}"))


def session_cases(v1) -> list[Case]:
    out = []
    for i, (name, opening) in enumerate(sessions_refused(v1).items()):
        opening = {"session": f"net-refused-{i}", "settings": v1.Settings()} | opening
        out.append(Case(f"Stream: {name}", True, call=lambda client, opening=opening: status_first(
            *client.session(range(2), **opening))))
    out += [Case(f"Stream: token, {change} changed", True, call=lambda client, change=change: changed_token(
        client, change)) for change in ("a bit", "its length", "settings", "session", "nothing")]
    headers = {"sequence back": ({"sequence": 5}, {"sequence": 4}),
               "sequence again": ({"sequence": 5}, {"sequence": 5}),
               "time back": ({"media_time_ns": 9}, {"media_time_ns": 8}), "time below 0": ({"media_time_ns": -1},),
               "a wide frame": ({"width": 20000},), "a gap": ({"sequence": 1}, {"sequence": 40}),
               "a said cut": ({}, {"cut": True})}
    out += [Case(f"Stream: {name}", True, call=lambda client, name=name, parts=parts: sequence_of(
        client, name, *parts)) for name, parts in headers.items()]
    out += [Case(f"Stream: {changes} changes from frame {first}", True,
                 call=lambda client, changes=changes, first=first: early_change(client, changes, first))
            for changes, first in ((1, 0), (1, 1), (16, 1), (17, 1))]
    return out
