"""A bus whose time is counted: frames arrive at once, or as a disturbance says, and waiting costs nothing.

with simulated(monkeypatch) as bus:
    bus.disturbance = ...      (frame, tick) → the frames that arrive in its place
"""

import heapq
import itertools

import can
import numpy as np

from armwright.twin import clock

NUMBERS = itertools.count()


class SimulatedBus:
    """All ends of a bus, and its clock [s]."""

    def __init__(self):
        self.ends, self.time, self.syncs = [], 0.0, 0
        self.disturbance = lambda frame, sender, bus: [frame]
        self.due = []  # (time, number, function) that are to happen later
        self.sent = []  # (time, identifier, data) of all frames that were sent

    def open(self, name):
        self.ends.append(End(self))
        return self.ends[-1]

    def carry(self, frame, sender):
        if frame.arbitration_id == 0x80:
            self.syncs += 1
        self.sent.append((self.time, frame.arbitration_id, bytes(frame.data)))
        for each in self.disturbance(frame, sender, self):
            self.deliver(each, sender)

    def deliver(self, frame, sender):
        for end in self.ends:
            if end is not sender:
                for listener in end.listeners:
                    listener(frame)

    def later(self, delay, function):
        heapq.heappush(self.due, (self.time + delay, next(NUMBERS), function))

    def wait_until(self, time):
        while self.due and self.due[0][0] <= time:
            self.time, _, function = heapq.heappop(self.due)
            function()
        self.time = max(self.time, time)


class End(can.BusABC):
    """One end: what it sends arrives at the others before `send` returns."""

    def __init__(self, bus):
        self.bus, self.listeners, self.tasks = bus, [], []
        super().__init__(channel="simulated")
        self.channel_info = "simulated"

    def send(self, msg, timeout=None):
        self.bus.carry(msg, self)

    def _recv_internal(self, timeout):
        return None, True

    def shutdown(self):
        self.listeners = []
        for task in self.tasks:
            task.stop()
        super().shutdown()

    def send_periodic(self, msgs, period, *arguments, **options):
        self.tasks.append(Task(self, msgs, period))
        return self.tasks[-1]


class Task:
    """A frame that is sent again and again."""

    def __init__(self, end, message, period):
        self.end, self.message, self.period, self.on = end, message, period, True
        self._beat()

    def _beat(self):
        if self.on:
            self.end.send(self.message)
            self.end.bus.later(self.period, self._beat)

    def stop(self):
        self.on = False

    def modify_data(self, message):
        self.message = message


class Notifier:
    """Stands for python-can's thread: the listeners are called by the sender."""

    exception = None

    def __init__(self, bus, listeners, timeout):
        self.bus = bus
        bus.listeners = list(listeners)

    def stop(self, timeout=0.0):
        self.bus.listeners = []


def simulated(monkeypatch):
    """A bus in place of those that are named, and its clock in place of the computer's."""
    bus = SimulatedBus()
    monkeypatch.setattr("armwright.twin.master.open_bus", bus.open)
    monkeypatch.setattr("armwright.twin.twin.open_bus", bus.open)
    monkeypatch.setattr("can.Notifier", Notifier)
    monkeypatch.setattr(clock, "now", lambda: bus.time)
    monkeypatch.setattr(clock, "sleep_until", bus.wait_until)

    def wait(condition, done, until):
        if not done():
            bus.wait_until(until)
        return done()

    monkeypatch.setattr(clock, "wait", wait)
    monkeypatch.setattr("armwright.twin.master.ANSWER", 0.05)
    return bus


class Chaos:
    """Disturbances of the frames of one node, or of all, from a moment on [cycles].

    Args:
        kind: "kill", "silence", "freeze", "reorder", "duplicate", "drop", "second" or "unplug".
        at: SYNC from which on.   node: its number.   seed: of what is drawn.
    """

    KINDS = ("kill", "silence", "freeze", "reorder", "duplicate", "drop", "second", "unplug")

    def __init__(self, kind, at, node, seed):
        self.kind, self.at, self.node, self.rng = kind, at, node, np.random.default_rng(seed)
        self.share = self.rng.uniform(0.01, 0.3)
        self.last, self.first = {}, {}

    def __call__(self, frame, sender, bus):
        number, from_twin = frame.arbitration_id & 0x7F, sender is bus.ends[0]
        answer = from_twin and 0x180 <= frame.arbitration_id < 0x200
        if answer and bus.syncs < self.at:
            self.last[number] = frame
        if bus.syncs < self.at or frame.arbitration_id == 0x80:
            return [frame]
        process_data = 0x180 <= frame.arbitration_id < 0x280
        mine = number == self.node
        if self.kind == "kill":
            return [] if from_twin else [frame]
        if self.kind == "silence":
            return [] if from_twin and mine else [frame]
        if self.kind == "freeze":  # its controller goes on answering with what it had; its heart stands still
            if from_twin and mine and frame.arbitration_id >= 0x700:
                return []
            return [self.last[number]] if answer and mine else [frame]
        if self.kind == "unplug":  # for 30 cycles, either way; then the device starts anew
            gone = bus.syncs < self.at + 30
            if mine and frame.arbitration_id >= 0x180:
                if gone:
                    return []
                if from_twin and not self.first.setdefault(number, 0):
                    self.first[number] = 1
                    return [can.Message(arbitration_id=0x700 + number, data=[0], is_extended_id=False)]
                return [] if answer else [frame]
            return [frame]
        if self.kind == "second":  # one with this number that stands elsewhere and answers too
            if answer and mine:
                other = bytes(frame.data[:4]) + (int.from_bytes(frame.data[4:], "little", signed=True) + 5000).to_bytes(
                    4, "little", signed=True
                )
                return [frame, can.Message(arbitration_id=frame.arbitration_id, data=other, is_extended_id=False)]
            return [frame]
        if process_data and self.rng.random() < self.share:
            if self.kind == "drop":
                return []
            if self.kind == "duplicate":
                return [frame, frame]
            bus.later(self.rng.uniform(0.0, 8e-3), lambda: bus.deliver(frame, sender))  # reorder: it comes later
            return []
        return [frame]
