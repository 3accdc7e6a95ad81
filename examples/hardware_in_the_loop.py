"""A controller on a device of its own holds the tip of a simulated arm, over UDP.

    python examples/hardware_in_the_loop.py                # the device is a second process
    python examples/hardware_in_the_loop.py HOST:PORT      # a device elsewhere
    python examples/hardware_in_the_loop.py --device PORT  # the device alone

In each control period the arm's side sends a datagram of eight little-endian doubles: number, time
(s), measured x, z (m) and angle (rad), reference x, z and angle. The device answers with three: the
number, slide (m) and tilt (rad). The arm keeps its last command where no answer comes in time.
"""

from __future__ import annotations

import multiprocessing
import socket
import struct
import sys

SEEN, COMMAND = struct.Struct("<8d"), struct.Struct("<3d")
DURATION = 10.0  # s


def device(link: socket.socket) -> None:
    """Answer measurements with commands, as the firmware of a controller does."""
    period, slide, tilt = 0.01, 0.0, 0.0
    while True:
        packet, sender = link.recvfrom(256)
        if len(packet) != SEEN.size:
            return  # the end of the run
        number, _, x, _, angle, to_x, _, to_angle = SEEN.unpack(packet)
        behind, turned = to_x - x, to_angle - angle
        slide += 5.0 * period * (behind + 0.5 * turned)
        tilt += 5.0 * period * turned
        link.sendto(COMMAND.pack(number, slide, tilt), sender)


def hold(address: tuple[str, int]) -> None:
    """Run the arm against the wall clock, with the device as its controller."""
    import numpy as np

    import crinoid

    scenario = crinoid.load("station-keeping").with_values({"simulation.duration": DURATION})
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.connect(address)
    with crinoid.Session(scenario, paced=True) as session:
        link.settimeout(0.5 * session.period)
        seen, lost, number, command = session.reset(), 0, 0, {"slide": 0.0, "tilt": 0.0}
        while not session.ended:
            number += 1
            link.send(SEEN.pack(number, session.time, *seen.measured, *seen.reference))
            try:
                answer, *values = COMMAND.unpack(link.recv(256))
                while answer < number:  # late answers of earlier periods
                    answer, *values = COMMAND.unpack(link.recv(256))
                command = dict(zip(("slide", "tilt"), values, strict=True))
            except (OSError, struct.error):  # nothing in time, nobody there, or nonsense
                lost += 1
            seen = session.step(command)
        link.send(b"end")
        result = session.result()
    error = result.dataset["tip_error"].sel(time=slice(3.0, None)).values
    print(f"RMS tip error from 3 s on {1e3 * np.sqrt(np.mean(error**2)):.2f} mm")
    print(f"{lost} of {number} answers lost, {session.late.late} steps late")
    result.save("results/hardware-in-the-loop")


def main(arguments: list[str]) -> None:
    """Run the device, the arm, or both."""
    if arguments and arguments[0] != "--device":
        host, _, port = arguments[0].partition(":")
        if not (host and port.isdigit()):
            raise SystemExit(f"device: got {arguments[0]}; must be HOST:PORT")
        hold((host, int(port)))
        return
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("", int(arguments[1])) if arguments else ("127.0.0.1", 0))
    if arguments:
        device(link)
        return
    other = multiprocessing.get_context("spawn").Process(target=device, args=(link,), daemon=True)
    other.start()
    hold(link.getsockname())
    other.join(1.0)


if __name__ == "__main__":
    main(sys.argv[1:])
