"""Environments and views: commands, calls of the net's own client, and what is refused."""
import itertools
import struct
from collections.abc import Callable, Iterator

import grpc

from cases import Case, command
from outcome import Outcome, digest
from refusals import status_first
from scenes import many_objects
from wire import Client, outcome_of, read_pfm

SAMPLE, NOISE = "{scenes}/panoramas/sample-64x32.pfm", "{scenes}/panoramas/noise-61x31.pfm"
LARGE_SAMPLE = "{scenes}/panoramas/sample-512x256.exr"
SMALL_VIEWS = ["out.png --objects lookdev", "out.pfm --fov 120 --yaw 170 --pitch 60 --rotation -37.5",
               "%04d.png --turn 360 --frames 6"]
CAMERAS = ["out.pfm", "out.pfm --fov 1", "out.pfm --fov 20", "out.pfm --fov 170", "out.pfm --yaw 180",
           "out.pfm --pitch 90", "out.pfm --pitch -90 --roll 45", "out.pfm --rotation 90"]
VIEWS = ["out.exr --roll -30", "out.png --bits 16", "out.jpg", "out.pfm --size 1x1", "out.pfm --size 33x21",
         "out.pfm --size 2x333", "out.pfm --samples 1 --objects lookdev", "out.pfm --samples 16 --objects lookdev",
         "out.pfm --objects {scenes}/panoramas/objects.json", "out.pfm --curve agx", "out.pfm --bloom gaussian",
         "out.pfm --bloom-intensity 0", "out.pfm --metering percentile", "out.pfm --exposure -1",
         "out.pfm --white-balance 4000", "out.pfm --primaries aces-ap1", "out.pfm --tier draft",
         "out.pfm --tier reference --objects lookdev", "out.pfm --verify",
         "%04d.png --turn -90 --frames 7 --lookahead 2",
         "%04d.png --path {scenes}/panoramas/keys.json --objects lookdev",
         "%04d.jpg --turn 40 --frames 3 --encoding jpeg", "%04d.pfm --turn 360 --frames 4 --size 33x21"]
SMALL_BAKES = ["out.ktx2 --size 64 --sh {out}/sh.json", "faces/ --size 16 --format rgb9e5 --handedness right",
               "cross.exr --layout cross --size 32 --rotation 90"]
BAKES = ["out.ktx2", "out.ktx2 --size 128", "out.ktx2 --size 128 --levels 2", "out.ktx2 --size 64 --levels 1",
         "out.ktx2 --size 64 --format rgb9e5", "out.ktx2 --size 64 --handedness right",
         "out.ktx2 --size 64 --rotation -123.4 --sh {out}/sh.json",
         "out.ktx2 --size 64 --roughness-mapping perceptual", "out.ktx2 --size 64 --tier draft",
         "out.ktx2 --size 64 --tier reference", "out.ktx2 --size 64 --verify",
         "out.ktx2 --size 64 --preview {out}/sheet.png", "out.ktx2 --size 64 --primaries rec2020", "faces/ --size 32",
         "out.exr --size 32", "out.exr --size 32 --levels 2", "out.exr --size 32 --layout equirectangular",
         "cross.exr --layout cross --size 64 --levels 3"]
WRONG_VIEWS = ["--fov 0.5", "--fov 171", "--yaw nan", "--rotation 361", "--size 0x5", "--samples 2",
               "--objects no-such-file.json", "--turn 360 --frames 0",
               "--turn 360 --path {scenes}/panoramas/keys.json", "--frames 5"]
WRONG_BAKES = ["out.ktx2 --size 24", "out.ktx2 --size 8192", "out.ktx2 --levels 10", "out.ktx2 --size 16 --levels 2",
               "out.ktx2 --format rgba32f", "out.ktx2 --layout cross", "out.ktx2 --handedness up",
               "out.ktx2 --rotation 361", "out.ktx2 --roughness-mapping square", "out.ktx2 --tier best", "out.png",
               "cross.exr --layout faces"]
REAL = ("hdri/dikhololo_night_1k.hdr", "hdri/kiara_1_dawn_1k.hdr", "hdri/lebombo_1k.hdr",
        "hdri/studio_small_03_1k.hdr", "exr/StageEnvLatLong.exr")
NOBODYS_ID = "0123456789abcdef" * 4


# ---- Commands ---------------------------------------------------------------------------------------------

def view(panorama: str, options: str, small: bool = False, only_exit: bool = False) -> Case:
    size = "" if "--size" in options else " --size 96x54"
    return command(f"view {panorama} {{out}}/{options}{size}", small, only_exit=only_exit)


def environment(panorama: str, options: str, small: bool = False, only_exit: bool = False) -> Case:
    return command(f"environment {panorama} {{out}}/{options}", small, only_exit=only_exit)


def command_cases() -> Iterator[Case]:
    yield command("sample --panorama {out}/panorama.exr --size 64x32", True, server=False, json_too=False)
    yield command("sample --panorama {out}/panorama.pfm --size 33x21", server=False, json_too=False)
    for options in SMALL_VIEWS + CAMERAS + VIEWS:
        yield view(SAMPLE, options, options in SMALL_VIEWS)
    for options in SMALL_BAKES + BAKES:
        yield environment(SAMPLE, options, options in SMALL_BAKES)
    for options in SMALL_VIEWS + CAMERAS:
        yield view(NOISE, options)
    for options in SMALL_BAKES:
        yield environment(NOISE, options)
    bad_values = "{scenes}/bad-values.pfm"  # also not twice as wide as high
    for options in ("", " --bad-values reject"):
        yield view(bad_values, f"out.pfm{options}")
        yield environment(bad_values, f"out.ktx2 --size 16{options}")
    for options in ("out.png --objects lookdev", "%04d.png --turn 360 --frames 8 --lookahead 3"):
        yield view(LARGE_SAMPLE, options)
    for options in ("out.ktx2", "out.ktx2 --size 512 --levels 3 --format rgb9e5", "cross.exr --layout cross"):
        yield environment(LARGE_SAMPLE, options)
    yield command(f"view {SAMPLE} {{out}}/out.png --size 96x54", server=False)
    yield command(f"environment {SAMPLE} {{out}}/out.ktx2 --size 32", server=False)
    for options in WRONG_VIEWS:
        yield view(SAMPLE, f"out.png {options}", only_exit=True)
    for options in WRONG_BAKES:
        yield environment(SAMPLE, options, only_exit=True)
    yield view("{scenes}/no-such-file.exr", "out.png", only_exit=True)


def data_cases() -> Iterator[Case]:
    for file in REAL:
        path = f"{{data}}/{file}"
        for options in ("out.png --size 320x180 --objects lookdev",
                        "out.pfm --size 161x91 --fov 100 --yaw 180 --rotation 45",
                        "out.pfm --size 160x90 --pitch 80 --fov 20",
                        "%04d.png --size 160x90 --turn 360 --frames 8"):
            yield view(path, options)
        for options in ("out.ktx2 --sh {out}/sh.json", "faces/ --size 64 --format rgb9e5 --handedness right",
                        "out.exr --size 128 --levels 2 --roughness-mapping perceptual",
                        "cross.exr --layout cross --size 64"):
            yield environment(path, options)


# ---- Calls ------------------------------------------------------------------------------------------------

def panorama_of(client: Client) -> tuple[int, int, bytes]:
    return read_pfm(client.scenes / "panoramas" / "sample-64x32.pfm")


def halves(pixels: bytes) -> bytes:
    count = len(pixels) // 4
    return struct.pack(f"<{count}e", *struct.unpack(f"<{count}f", pixels))


def put(client: Client, pixels: bytes | None = None, rows: int | None = None, **start):
    """PutEnvironment of the sample as halves, or of `pixels`. Only the first `rows` rows are sent if that is said."""
    v1, (width, height, floats) = client.v1, panorama_of(client)
    start = {"width": width, "height": height, "format": v1.PIXEL_FORMAT_RGBA16F} | start
    pixels = halves(floats) if pixels is None else pixels
    if rows is not None:
        pixels = pixels[:len(pixels) // start["height"] * rows]
    return client.stub.PutEnvironment(iter([v1.PutEnvironmentRequest(start=v1.EnvironmentStart(**start)),
                                            v1.PutEnvironmentRequest(band=v1.Band(pixels=pixels))]), timeout=120)


def harmonics(numbers) -> dict[str, str]:
    return {f"radiance_sh[{i}]": repr(number) for i, number in enumerate(numbers)}


def facts(found) -> dict[str, str]:
    """What an Environment says, without what it costs and whether another case has put it there before."""
    names = ("id", "width", "height", "default_cube_size", "nan_components", "infinite_components",
             "negative_components")
    return {name: repr(getattr(found, name)) for name in names} | harmonics(found.radiance_sh)


def call(name: str, make: Callable[[Client], Outcome], small: bool = False) -> Case:
    """A case of the net's own client. A refusal's outcome is its status."""
    def outcome(client: Client) -> Outcome:
        try:
            return make(client)
        except grpc.RpcError as error:
            return Outcome(error.code().name)
    return Case(name, small, call=outcome)


def put_twice(client: Client) -> Outcome:
    """The life of a panorama that no other case puts."""
    v1 = client.v1
    start = {"width": 3, "height": 2, "format": v1.PIXEL_FORMAT_RGB9E5, "pixels": bytes(range(24))}
    first, second = put(client, **start), put(client, **start)
    kept = client.stub.GetEnvironment(v1.GetEnvironmentRequest(id=first.id), timeout=120)
    dropped = client.stub.DropEnvironment(v1.DropEnvironmentRequest(id=first.id), timeout=120)
    values = facts(first) | {"had it": f"{first.had_it} {second.had_it}", "same id": str(first.id == second.id),
                             "kept": str(facts(kept) == facts(first)), "in use": str(dropped.in_use)}
    try:
        client.stub.GetEnvironment(v1.GetEnvironmentRequest(id=first.id), timeout=120)
    except grpc.RpcError as error:
        return Outcome(error.code().name, values=values)
    return Outcome("OK", values=values)


def bake(client: Client, **request) -> Outcome:
    v1 = client.v1
    request = {"id": put(client).id, "format": v1.PIXEL_FORMAT_RGBA16F} | request
    values, faces, image = {}, [], b""
    for response in client.stub.BakeEnvironment(v1.BakeEnvironmentRequest(**request), timeout=120):
        part = response.WhichOneof("part")
        if part == "header":
            header = response.header
            values = {name: repr(getattr(header, name)) for name in ("size", "tier", "negative_components",
                                                                     "clamped_components")}
            values |= harmonics(header.radiance_sh)
            for i, level in enumerate(header.levels):
                error = f" {level.error!r}" if level.HasField("error") else ""
                values[f"levels[{i}]"] = f"{level.size} {level.roughness!r}{error}"
        elif part == "face":
            faces.append(f"{response.face.level}.{response.face.face}")
        else:
            image += response.band.pixels
    return Outcome("OK", digest(image), values | {"faces": " ".join(faces), "bytes": str(len(image))})


def spheres(v1, count: int = 64) -> list:
    out = []
    for i in range(count):
        sphere = many_objects()[i % 64]
        out.append(v1.Sphere(**sphere | {name: v1.Vector(**dict(zip("xyz", sphere[name])))
                                         for name in ("centre", "base_color")}))
    return out


def render_view(client: Client, size: tuple[int, int] = (96, 54), **fields) -> Outcome:
    """A view as an image of halves, because 8 bits hide differences."""
    v1 = client.v1
    shown = v1.View(**{"environment": put(client).id} | fields)
    return client.render(v1.Settings(output_format=v1.OUTPUT_FORMAT_RGBA16F),
                         frame={"width": size[0], "height": size[1], "view": shown})


def views(v1) -> dict[str, dict]:
    camera = v1.Camera
    out = {f"fov {fov}": {"camera": camera(fov_deg=fov)} for fov in (0, 1, 25, 90, 170)}
    out |= {f"rotation {rotation}": {"rotation_deg": rotation} for rotation in (90, -123.4, 360)}
    out |= {f"{width}x{height}": {"size": (width, height)} for width, height in ((1, 1), (33, 21), (2, 333))}
    out |= {f"64 objects, {samples} samples": {"objects": spheres(v1), "samples": samples} for samples in (0, 1, 16)}
    out |= {"angles": {"camera": camera(yaw_deg=1000, pitch_deg=-20, roll_deg=7)},
            "a quaternion": {"camera": camera(orientation=v1.Quaternion(x=0.5, y=0.5, z=-0.5, w=0.5))},
            "a position among objects": {"camera": camera(position=v1.Vector(x=1, y=-0.5, z=-4)),
                                         "objects": spheres(v1, 20)}}
    return out


def mixed_session(client: Client, **opening) -> Outcome:
    """Views of two panoramas and frames with pixels, and another session that continues from frame 3's token."""
    v1 = client.v1
    sample, noise = put(client).id, put(client, pixels=bytes(range(256)) * 2, width=16, height=8,
                                        format=v1.PIXEL_FORMAT_RGB9E5).id

    def messages(frames: range) -> list:
        out = []
        for i in frames:
            if i % 3 == 1:
                out += client.frame_messages(client.frames[i], v1.StreamRequest, i)
                continue
            shown = v1.View(environment=noise if i % 4 == 2 else sample, camera=v1.Camera(yaw_deg=50 * i),
                            objects=spheres(v1, i))
            out.append(v1.StreamRequest(frame=v1.FrameHeader(sequence=i, width=40, height=30, view=shown,
                                                             media_time_ns=i * 40_000_000)))
        return out

    opening |= {"settings": v1.Settings()}
    status, results = client.stream(messages(range(8)), **opening)
    if status != "OK":
        return outcome_of(status, results)
    again_status, again = client.stream(messages(range(4, 8)), resume_token=results[3][2], **opening)
    return outcome_of(f"{status} {again_status}", results + again)


def call_cases(v1) -> list[Case]:
    out = [call("PutEnvironment: RGBA16F", lambda client: Outcome("OK", values=facts(put(client))), True),
           call("PutEnvironment: twice and dropped", put_twice)]

    def put_case(name: str, pixels: Callable[[bytes], bytes], **start) -> Case:
        return call(f"PutEnvironment: {name}", lambda client: Outcome("OK", values=facts(
            put(client, pixels(panorama_of(client)[2]), **start))))

    # The float pixels' bytes, taken as another format: any bits at all, and NaN among them.
    floats, any_bits = v1.PIXEL_FORMAT_RGBA32F, {"format": v1.PIXEL_FORMAT_RGB9E5, "height": 128}
    out += [put_case("RGBA32F", bytes, format=floats), put_case("any bits as RGB9E5", bytes, **any_bits),
            put_case("any bits as RGBA16F", bytes, height=64),
            put_case("1x1", lambda pixels: pixels[:8], width=1, height=1),
            put_case("primaries", halves, input_primaries=v1.PRIMARIES_REC2020),
            put_case("rows with padding", bytes, width=50, format=floats, row_stride_bytes=1024)]
    formats = (("RGBA16F", v1.PIXEL_FORMAT_RGBA16F), ("RGB9E5", v1.PIXEL_FORMAT_RGB9E5))
    for (name, pixel_format), size in itertools.product(formats, (0, 16, 64, 256)):
        request = {"format": pixel_format, "size": size}
        out.append(call(f"BakeEnvironment: {name}, size {size}", lambda client, request=request: bake(
            client, **request), name == "RGB9E5" and size == 64))
    bakes = {"1 level": {"size": 128, "levels": 1}, "2 levels": {"size": 128, "levels": 2},
             "verified": {"verify": True}, "rotation -123.4": {"rotation_deg": -123.4},
             "tier draft": {"tier": "draft", "size": 64},
             "tier reference": {"tier": "reference", "size": 64},
             "perceptual": {"roughness_mapping": v1.ROUGHNESS_MAPPING_PERCEPTUAL, "size": 64}}
    out += [call(f"BakeEnvironment: {name}", lambda client, request=request: bake(client, **request))
            for name, request in bakes.items()]
    out += [call(f"Render: view, {name}", lambda client, fields=fields: render_view(client, **fields),
                 name == "64 objects, 0 samples") for name, fields in views(v1).items()]
    kinds = {"plain": {}, "look-ahead and cuts": {"lookahead": 3, "cut_threshold_ev": 0.5},
             "png": {"encoding": v1.ENCODING_PNG}}
    for name, kind in kinds.items():
        kind["session"] = f"net-views-{name.replace(' ', '-')}"
        out.append(call(f"Stream: views and pixels, {name}", lambda client, kind=kind: mixed_session(client, **kind),
                        name == "plain"))
    return out


# ---- Refusals ---------------------------------------------------------------------------------------------

def puts_refused(v1) -> dict[str, dict]:
    nan = struct.pack("<e", float("nan"))
    return {"width 0": {"width": 0}, "width 8193": {"width": 8193}, "height 4097": {"height": 4097},
            "no format": {"format": 0}, "format 99": {"format": 99}, "short stride": {"row_stride_bytes": 8},
            "wrong total": {"total_bytes": 5}, "a row missing": {"rows": 31}, "a row too many": {"height": 31},
            "NaN rejected": {"width": 1, "height": 1, "pixels": 4 * nan, "bad_values": v1.BAD_VALUES_REJECT},
            "bad_values 99": {"bad_values": 99}, "input_primaries 99": {"input_primaries": 99},
            "primaries twice": {"input_primaries": v1.PRIMARIES_XYZ,
                                "input_chromaticities": v1.Chromaticities(red_x=0.6)}}


def bakes_refused(v1) -> dict[str, dict]:
    return {"size 24": {"size": 24}, "size 8": {"size": 8}, "size 8192": {"size": 8192}, "levels 9": {"levels": 9},
            "levels 2 of size 16": {"size": 16, "levels": 2}, "no format": {"format": 0},
            "RGBA32F": {"format": v1.PIXEL_FORMAT_RGBA32F}, "rotation_deg 361": {"rotation_deg": 361},
            "rotation_deg nan": {"rotation_deg": float("nan")}, "tier fast": {"tier": "fast"},
            "roughness_mapping 9": {"roughness_mapping": 9}, "an unknown id": {"id": NOBODYS_ID},
            "an id that is none": {"id": "pano"}, "no id": {"id": ""}}


def views_refused(v1) -> dict[str, dict]:
    camera, nan = v1.Camera, float("nan")

    def sphere(**fields) -> dict:
        return {"objects": [v1.Sphere(**{"centre": v1.Vector(z=-4), "radius": 1} | fields)]}

    out = {f"fov {fov}": {"camera": camera(fov_deg=fov)} for fov in (0.5, 171, nan)}
    out |= {f"yaw {yaw}": {"camera": camera(yaw_deg=yaw)} for yaw in (360001, nan)}
    out |= {f"rotation {rotation}": {"rotation_deg": rotation} for rotation in (361, nan)}
    out |= {"an unknown id": {"environment": NOBODYS_ID}, "an id that is none": {"environment": "pano"},
            "a quaternion of length 2": {"camera": camera(orientation=v1.Quaternion(w=2))},
            "a quaternion and angles": {"camera": camera(orientation=v1.Quaternion(w=1), yaw_deg=1)},
            "a position too far away": {"camera": camera(position=v1.Vector(x=2e6))}, "samples 2": {"samples": 2},
            "65 objects": {"objects": spheres(v1, 65)}, "radius 0": sphere(radius=0), "radius nan": sphere(radius=nan),
            "base_color 2": sphere(base_color=v1.Vector(x=2)), "metallic 2": sphere(metallic=2),
            "roughness -1": sphere(roughness=-1), "the camera in a sphere": sphere(radius=5),
            "width 0": {"size": (0, 5)}, "width 20000": {"size": (20000, 5)}}
    return out


def view_with_pixels(client: Client) -> Outcome:
    """A view's frame brings none."""
    v1 = client.v1
    header = v1.FrameHeader(width=4, height=1, view=v1.View(environment=put(client).id))
    requests = [v1.RenderRequest(start=v1.RenderStart(settings=v1.Settings(), frame=header)),
                v1.RenderRequest(band=v1.Band(pixels=bytes(32)))]
    for _ in client.stub.Render(iter(requests), timeout=120):
        pass
    return Outcome("OK")


def by_id(client: Client, name: str, identity: str) -> Outcome:
    """GetEnvironment or DropEnvironment."""
    request = getattr(client.v1, f"{name}EnvironmentRequest")(id=identity)
    getattr(client.stub, f"{name}Environment")(request, timeout=120)
    return Outcome("OK")


def session_of_unknown(client: Client) -> Outcome:
    v1 = client.v1
    messages = client.frame_messages(client.frames[0], v1.StreamRequest, 0)
    messages.append(v1.StreamRequest(frame=v1.FrameHeader(sequence=1, width=40, height=30, media_time_ns=40_000_000,
                                                          view=v1.View(environment=NOBODYS_ID))))
    return status_first(*client.stream(messages, session="net-view-of-unknown", settings=v1.Settings()))


def refusal_cases(v1) -> list[Case]:
    out = [call(f"PutEnvironment: {name}", lambda client, start=start: Outcome("OK", values=facts(
        put(client, **start)))) for name, start in puts_refused(v1).items()]
    out += [call(f"BakeEnvironment: {name}", lambda client, request=request: bake(client, **request),
                 name == "size 24") for name, request in bakes_refused(v1).items()]
    out += [call(f"Render: view, {name}", lambda client, fields=fields: render_view(client, **fields),
                 name == "65 objects") for name, fields in views_refused(v1).items()]
    out += [call("Render: view with pixels", view_with_pixels),
            call("Render: view with a format", lambda client: client.render(v1.Settings(), frame={
                "width": 4, "height": 1, "format": v1.PIXEL_FORMAT_RGBA16F,
                "view": v1.View(environment=put(client).id)})),
            call("Stream: view of an unknown environment", session_of_unknown, True)]
    for name, (what, identity) in itertools.product(("Get", "Drop"), (("an unknown id", NOBODYS_ID),
                                                                      ("an id that is none", "pano"))):
        out.append(call(f"{name}Environment: {what}", lambda client, name=name, identity=identity: by_id(
            client, name, identity), name == "Get" and identity == NOBODYS_ID))
    return out
