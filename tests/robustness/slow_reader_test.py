"""Sessions that send frames and read nothing: they keep little, are disconnected, and disturb nobody."""
import threading
import time

import harness
from harness import rpc, v1

READERS, WIDTH, HEIGHT = 20, 640, 360
IDLE_SECONDS = 4


def unread_session(address: str, name: str, over: threading.Event) -> None:
    """Sends frames for as long as the server takes them, and never asks for a result."""
    def requests():
        yield v1.StreamRequest(open=v1.StreamOpen(session=name))
        pixels = harness.grey(WIDTH, HEIGHT)
        for sequence in range(1000):
            yield from harness.frame_requests(sequence, WIDTH, HEIGHT, pixels)
        over.wait()

    with harness.channel(address) as channel:
        call = rpc.RenderServiceStub(channel).Stream(requests(), timeout=60)
        over.wait()
        call.cancel()


def main() -> None:
    with harness.Daemon("--idle-timeout", f"{IDLE_SECONDS}s") as daemon:
        control = harness.beside_fair_neighbour(daemon.address)
        before = daemon.resident_mib()
        over = threading.Event()
        readers = [threading.Thread(target=unread_session, args=(daemon.address, f"unread-{i}", over)) for i in range(READERS)]
        for reader in readers:
            reader.start()
        time.sleep(IDLE_SECONDS / 2)  # each has sent what the server takes, and nothing of it moves
        bystander = harness.Bystander(daemon.address)
        sessions, memory = daemon.series("candela_sessions")[""], daemon.resident_mib()
        # Twice the timeout for a busy machine; the connections stay open all that time.
        ended = harness.wait_until(lambda: daemon.series("candela_sessions")[""] == 1, 3 * IDLE_SECONDS)
        beside = bystander.result()
        in_use = daemon.series("candela_memory_bytes")['pool="textures_in_use"']
        over.set()
        for reader in readers:
            reader.join()
        harness.report(readers=sessions - 1, control=control, beside=beside, mib=[round(before), round(memory)], in_use=in_use)
        harness.expect(sessions == READERS + 1, f"only {sessions - 1:.0f} sessions of {READERS} were there")
        harness.expect(ended, "sessions that read nothing are still there after three idle timeouts")
        harness.expect_undisturbed(beside, control, f"{READERS} sessions that read nothing")
        # The textures of two frames, and what the memory limit is divided by; see docs/architecture.md.
        each = 2 * WIDTH * HEIGHT * 17.4 / 2**20 + 12
        harness.expect(memory - before < READERS * each, f"they took {memory - before:.0f} MiB")


main()
