"""Sessions that send frames and read nothing: they keep little, are disconnected, and disturb nobody.

The control is a server that waits ten minutes for readers, and readers whose frames are nine times as large: the verdicts on
their end and on their memory must both fail there.
"""
import dataclasses
import threading
import time

import harness
from harness import rpc, v1

READERS, WIDTH, HEIGHT = 20, 640, 360
IDLE_SECONDS = 4
# The textures of two frames, and what the memory limit is divided by; see docs/architecture.md.
LIMIT_MIB = READERS * (2 * WIDTH * HEIGHT * 17.4 / 2**20 + 12)


def unread_session(address: str, name: str, size: tuple[int, int], over: threading.Event) -> None:
    """Sends frames for as long as the server takes them, and never asks for a result."""
    def requests():
        yield v1.StreamRequest(open=v1.StreamOpen(session=name))
        pixels = harness.grey(*size)
        for sequence in range(1000):
            yield from harness.frame_requests(sequence, *size, pixels)
        over.wait()

    with harness.channel(address) as channel:
        call = rpc.RenderServiceStub(channel).Stream(requests(), timeout=60)
        over.wait()
        call.cancel()


@dataclasses.dataclass
class Seen:
    """What the readers did to a server: `mib` is the memory that they took, `in_use` the textures at the end in bytes."""

    sessions: int
    ended: bool
    mib: float
    in_use: float
    control: dict
    beside: dict


def readers_of(daemon: harness.Daemon, size: tuple[int, int]) -> Seen:
    control = harness.beside_fair_neighbour(daemon.address)
    before, over = daemon.resident_mib(), threading.Event()
    readers = [threading.Thread(target=unread_session, args=(daemon.address, f"unread-{i}", size, over)) for i in range(READERS)]
    for reader in readers:
        reader.start()
    time.sleep(IDLE_SECONDS / 2)  # each has sent what the server takes, and nothing of it moves
    bystander = harness.Bystander(daemon.address)
    sessions, memory = daemon.series("candela_sessions")[""] - 1, daemon.resident_mib()
    # Three timeouts for a busy machine; the connections stay open all that time.
    ended = harness.wait_until(lambda: daemon.series("candela_sessions")[""] == 1, 3 * IDLE_SECONDS)
    beside = bystander.result()
    in_use = daemon.series("candela_memory_bytes")['pool="textures_in_use"']
    over.set()
    for reader in readers:
        reader.join()
    seen = Seen(int(sessions), ended, round(memory - before), in_use, control, beside)
    harness.report(**dataclasses.asdict(seen), limit_mib=round(LIMIT_MIB))
    return seen


def main() -> None:
    with harness.Daemon("--idle-timeout", f"{IDLE_SECONDS}s") as daemon:
        seen = readers_of(daemon, (WIDTH, HEIGHT))
    harness.expect(seen.sessions == READERS, f"only {seen.sessions} sessions of {READERS} were there")
    harness.expect(seen.ended, "sessions that read nothing are still there after three idle timeouts")
    harness.expect_undisturbed(seen.beside, seen.control, f"{READERS} sessions that read nothing", harness.NIGHTLY_NOISE_MS)
    harness.expect(seen.mib < LIMIT_MIB, f"they took {seen.mib:.0f} MiB of {LIMIT_MIB:.0f}")
    with harness.Daemon("--idle-timeout", "10m") as daemon:
        patient = readers_of(daemon, (3 * WIDTH, 3 * HEIGHT))
    harness.expect(not patient.ended, "the control, a server that waits ten minutes, ended them, too")
    harness.expect(patient.mib > LIMIT_MIB, f"the control, readers with large frames, took only {patient.mib:.0f} MiB")
    harness.record_p99("slow_reader", seen.beside, seen.control)


main()
