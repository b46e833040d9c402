"""A small arm with limits, its twin, and an independent client: canopen as master on the same virtual bus."""

import itertools
from pathlib import Path

import numpy as np
import pytest

import armwright as aw
from armwright.twin import objects as od
from armwright.twin.twin import Twin

RECORD = Path(aw.__file__).parent / "robots" / "two-link.toml"
LIMITS = """
[joints.motor]
gear_ratio = 100.0
rotor_inertia_kg_m2 = {rotor}

[joints.limits]
position_rad = [-2.0, 2.0]
velocity_rad_per_s = 2.0
torque_n_m = {torque}
"""
CHANNELS = itertools.count()


@pytest.fixture(scope="session")
def arm_file(tmp_path_factory):
    """Two links behind gears of 100, driven by torques of at most 300 and 100 N m."""
    text = RECORD.read_text(encoding="utf-8")
    for torque, rotor in ((300.0, 1e-3), (100.0, 3e-4)):
        limits = LIMITS.format(torque=torque, rotor=rotor)
        text = text.replace("axis = [0.0, 0.0, 1.0]\n\n[[links]]", f"axis = [0, 0, 1]\n{limits}\n[[links]]", 1)
    path = tmp_path_factory.mktemp("twin") / "two.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(scope="session")
def arm(arm_file):
    """The small arm."""
    return aw.load(arm_file)


@pytest.fixture(scope="session")
def scenario(arm):
    """The arm with a cascade that moves both joints to and fro, at 4 ms."""

    def reference(t):
        there = 1.0 - aw.scalar.cos(4.0 * t)
        return aw.scalar.array([-1.2 + 0.1 * there, 0.2 * there])

    law = aw.Cascade(
        position_kp=15.0, speed_kp=[700.0, 160.0], speed_ki=[7000.0, 1600.0], speed_feedforward=1.0, delay_ticks=1
    )
    sensors = aw.Sensors(counts=360_000, side="link", velocity="difference")
    loop = aw.Loop(law, reference, period=4e-3, sensors=sensors, timing=aw.Timing("one-tick"))
    return aw.Scenario(arm, duration=0.8, loop=loop, start=[-1.2, 0.0])


@pytest.fixture
def bus():
    """Name of a virtual bus that no other test uses."""
    pytest.importorskip("canopen", reason='buses: pip install "armwright[twin]"')
    return f"virtual:test{next(CHANNELS)}"


class Client:
    """canopen as master: it sends SYNC and waits until the twin has done what belongs to it."""

    def __init__(self, twin):
        import canopen

        self.network = canopen.Network()
        self.network.NOTIFIER_CYCLE = 0.05
        self.network.connect(interface="virtual", channel=twin.bus.partition(":")[2])
        self.nodes = [self.network.add_node(n.number, od.dictionary(n.eds, n.number)) for n in twin.nodes]
        for node in self.nodes:
            node.sdo.RESPONSE_TIMEOUT = 20.0  # [s], for machines that do other work

    def close(self):
        self.network.disconnect()

    def __enter__(self):
        return self

    def __exit__(self, *exception):
        self.close()

    def get(self, key, k=0):
        index, sub = key
        node = self.nodes[k].sdo
        return node[index].raw if index not in od.RECORDS else node[index][sub].raw

    def put(self, key, value, k=0):
        index, sub = key
        if index in od.RECORDS:
            self.nodes[k].sdo[index][sub].raw = value
        else:
            self.nodes[k].sdo[index].raw = value

    def sync(self, count=1):
        for k in range(count):
            self.network.send_message(0x80, [])
            if k % 20 == 19:
                self.get(od.STATUSWORD)
        return self.get(od.STATUSWORD)  # answered behind all that came before it

    def word(self, value, k=0):
        """Sends a controlword, lets a SYNC pass, and gives the statusword."""
        self.put(od.CONTROLWORD, value, k)
        self.sync()
        return self.get(od.STATUSWORD, k)

    def enable(self, mode, *joints):
        self.network.send_message(0, [1, 0])
        for k in joints or range(len(self.nodes)):
            self.put(od.MODE, mode, k)
            for word in (0x06, 0x07, 0x0F):
                status = self.word(word, k)
            assert status & 0x6F == 0x27
            assert self.get(od.MODE_DISPLAY, k) == mode


@pytest.fixture
def twin(scenario, bus):
    """The twin on its bus."""
    with Twin(scenario, bus, serial=42) as found:
        yield found


@pytest.fixture
def client(twin):
    """A client on the same bus."""
    with Client(twin) as found:
        yield found


def radians(counts):
    return np.asarray(counts) * 2.0 * np.pi / 360_000
