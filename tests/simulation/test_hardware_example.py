"""The example with a controller on a device of its own."""

import re
import socket
from threading import Thread

import pytest

from helpers.paths import ROOT
from helpers.scripts import load_script


@pytest.mark.release
def test_a_device_behind_a_socket_controls_the_arm(monkeypatch, tmp_path, capsys):
    example = load_script(ROOT / "examples" / "hardware_in_the_loop.py")
    monkeypatch.setattr(example, "DURATION", 6.0)
    monkeypatch.chdir(tmp_path)
    link = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    link.bind(("127.0.0.1", 0))
    device = Thread(target=example.device, args=(link,), daemon=True)
    device.start()
    example.hold(link.getsockname())
    device.join(5.0)
    assert not device.is_alive()
    said = capsys.readouterr().out
    error, lost, sent = map(float, re.findall(r"([\d.]+) (?:mm|of|answers)", said))
    assert sent == 600
    assert lost < 300
    assert error < 25.0  # 38 mm without commands
