#!/usr/bin/env python3
"""Attacks on HTTP/2 against the shape that is shipped: nginx before candelad. `edge_test.py SHAPE SECONDS BIN [ATTACK...]`

SHAPE is container (the image, as podman runs it), processes (deploy/candela-front's nginx and candelad, both of this
machine), firewalled (the same behind deploy/firewall.nft) or direct (candelad alone, which fails: gRPC 1.51 has no defence).
Each attack lasts SECONDS. BIN contains candela and candelad. The attacker has an address of its own, and a bystander streams
small frames meanwhile. Expected:
- the bystander's session goes on. If SECONDS is 10 or more, its p99 is within 2 x of its p99 beside one fair neighbour in the
  same run, plus noise: 40 ms if SECONDS is 30 or more, otherwise 200 ms;
- new clients are served meanwhile;
- no process ends or restarts, and health is good afterwards;
- what must be refused or ended is (attacks.py says what);
- the memory stays below its limits, the front's below its own, and comes back;
- the attack reached the server, with most of the connections that it is about.
"""
import contextlib
import json
import os
import pathlib
import sys
import threading

HERE = pathlib.Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent / "robustness"))
os.environ["CANDELA_BIN"] = sys.argv[3] if len(sys.argv) > 3 else ""

import attacks  # noqa: E402
import harness  # noqa: E402
from harness import expect, report  # noqa: E402
from podman import attempt, wait_until  # noqa: E402
from shapes import SHAPES  # noqa: E402

MEASURED, LONG = 10, 30  # seconds: shorter attacks have too few frames for a p99, or for one without much noise
LIMIT_MIB = 1024  # of the shape's memory
FRONT_LIMIT_MIB = 256  # of the front's part: what its container in kube.yaml may use
EVERY = attacks.ATTACKS | attacks.ATTACKS_ON_A_FIREWALL
KEPT_MIB = 96  # that may stay with allocators after an attack


class Memory(threading.Thread):
    """Follows the shape's memory; `peak` and `front_peak` are in MiB."""

    def __init__(self, shape):
        super().__init__(daemon=True)
        self.shape, self.peak, self.front_peak, self.over = shape, 0.0, 0.0, threading.Event()
        self.start()

    def run(self) -> None:
        while not self.over.wait(0.2):
            self.peak = max(self.peak, self.shape.memory_mib())
            self.front_peak = max(self.front_peak, self.shape.front_mib())

    def result(self) -> dict:
        self.over.set()
        self.join()
        return {"at_most": round(self.peak), "front_at_most": round(self.front_peak)}


class Newcomers(threading.Thread):
    """Connects twice a second and renders a small frame; `refused` says how calls failed."""

    def __init__(self, shape):
        super().__init__(daemon=True)
        self.shape, self.calls, self.refused, self.over = shape, 0, [], threading.Event()
        self.start()

    def run(self) -> None:
        while not self.over.wait(0.5):
            code, words = harness.render(self.shape.address)
            self.calls += 1
            self.refused += [f"{code}: {words}"] if code != "OK" else []

    def result(self) -> dict:
        self.over.set()
        self.join()
        return {"calls": self.calls, "refused": len(self.refused), "words": self.refused[-1:]}


def attack(shape, name: str, seconds: float) -> tuple[dict, dict, dict, dict]:
    """What the attacker, the bystander and new clients say, and the most memory in MiB."""
    bystander, memory, newcomers = harness.Bystander(shape.address), Memory(shape), Newcomers(shape)
    prefix, source = shape.from_address(1 + list(EVERY).index(name))
    attacker = attempt(*prefix, sys.executable, HERE / "attacks.py", name, shape.address, seconds, source, timeout=seconds + 60)
    if attacker.returncode == harness.SKIPPED:
        harness.skip(attacker.stdout.strip())
    used, came, fared = memory.result(), newcomers.result(), bystander.result()
    expect(attacker.returncode == 0, f"the attack {name} did not run: {attacker.stderr}")
    return json.loads(attacker.stdout), fared, came, used


def healthy(shape) -> bool:
    return attempt(harness.binary("candela"), "health", "--server", shape.address).returncode == 0


def check_all_but_latency(shape, name: str, seconds: float) -> dict:
    """Attacks once. Returns what the bystander says, and `front_mib`, the most memory of the front."""
    before = shape.memory_mib()
    did, fared, came, used = attack(shape, name, seconds)
    report(attack=name, did=did, bystander=fared, newcomers=came, mib_before=round(before), mib=used)
    expect(did["connections"] > 0 and did.get("sent", 1) > 0, f"{name}: nothing was attacked: {did}")
    expect("wrong" not in did, f"{name}: {did.get('wrong')}")
    expect(not shape.trouble(), f"{name}: {shape.trouble()}")
    expect(came["calls"] > 0 and not came["refused"], f"{name}: new clients are refused: {came}")
    expect(used["at_most"] < LIMIT_MIB, f"{name}: {used['at_most']} MiB were in use, of {LIMIT_MIB}")
    expect(used["front_at_most"] > 0 or not shape.has_front, f"{name}: the front's memory cannot be read")
    expect(used["front_at_most"] < FRONT_LIMIT_MIB,
           f"{name}: the front used {used['front_at_most']} MiB, of {FRONT_LIMIT_MIB}")
    wait_until(lambda: healthy(shape), f"health is good after {name}", seconds=20)
    wait_until(lambda: shape.memory_mib() < before + KEPT_MIB, f"the memory is back after {name}",
               lambda: f"{before:.0f} MiB before, {shape.memory_mib():.0f} MiB after", 30, 0.5)
    return fared | {"front_mib": used["front_at_most"]}


def beside_fair_neighbour(shape, seconds: float) -> dict:
    control = harness.beside_fair_neighbour(shape.address, max(seconds, 6))
    report(beside_fair_neighbour=control)
    return control


def check(shape, name: str, seconds: float, control: dict | None) -> dict:
    fared = check_all_but_latency(shape, name, seconds)
    harness.expect_unbroken(fared, name)
    if control:
        harness.expect_undisturbed(fared, control, name,
                                   harness.NIGHTLY_NOISE_MS if seconds >= LONG else harness.SHORT_NOISE_MS)
    return fared


def main() -> None:
    shape_name, seconds = sys.argv[1], float(sys.argv[2])
    with contextlib.ExitStack() as stack:
        shape = SHAPES[shape_name](stack)
        wait_until(lambda: healthy(shape), "it serves", seconds=60)
        control = beside_fair_neighbour(shape, seconds) if seconds >= MEASURED else None
        start = shape.memory_mib()
        names = sys.argv[4:] or list(attacks.ATTACKS)
        checked = [check(shape, name, seconds, control) for name in names]
        report(mib_at_start=round(start), mib_at_end=round(shape.memory_mib()))
        if control and names in (list(attacks.ATTACKS), list(attacks.ATTACKS_ON_A_FIREWALL)):
            harness.record_p99(f"edge/{shape_name}", max(checked, key=lambda fared: fared["p99_ms"]), control)
            if shape_name == "container":
                harness.record("edge/container/front", max(fared["front_mib"] for fared in checked), "MiB")


if __name__ == "__main__":
    main()
