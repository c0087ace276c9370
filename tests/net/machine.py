"""The parts of a machine that the recorded results depend on: the Vulkan driver, the processor and the C library."""
import json
import pathlib
import platform
import subprocess

# The driver compiles shaders, and the C library picks its mathematics, by these.
FLAGS = ("sse4_1", "sse4_2", "avx", "avx2", "fma", "f16c", "avx512f", "avx512bw", "avx512cd", "avx512dq", "avx512vl")
FOR_PEOPLE = "processor"


def this_machine(candela: pathlib.Path) -> dict:
    info = json.loads(subprocess.run([candela, "info", "--json", "-"], check=True, stdout=subprocess.PIPE,
                                     timeout=120).stdout)
    lines = pathlib.Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    fields = {key.strip(): value.strip() for key, _, value in (line.partition(":") for line in lines)}
    present = fields.get("flags", "").split()
    return {"driver": info["device"]["driver"], "device": info["device"]["name"], "machine": platform.machine(),
            "flags": " ".join(flag for flag in FLAGS if flag in present), "libc": " ".join(platform.libc_ver()),
            FOR_PEOPLE: ", ".join(f"{key} {fields.get(key, '?')}" for key in ("model name", "cpu family", "model"))}


def difference(recorded: dict, here: dict) -> str:
    """The reason why results may differ from the recorded ones here; empty if they may not."""
    return "; ".join(f"{key} is {here.get(key)!r}, recorded with {recorded[key]!r}"
                     for key in recorded if key != FOR_PEOPLE and recorded[key] != here.get(key))
