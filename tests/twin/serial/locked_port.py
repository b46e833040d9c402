"""A port at whose other end an arm of servos answers in lock-step, in this process."""


class LockedPort:
    """Answers at once.

    Args:
        made: the arm of servos.   timing: its `LockStep`.
    """

    def __init__(self, made, timing):
        self.made, self.timing, self.waiting = made, timing, b""

    def write(self, data):
        """Takes instructions."""
        for frame in self.made.bus.feed(data, self.made.line.baud):
            self.waiting += self.timing.reply(frame, self.made.line.baud).data
            self.timing.close(frame)

    def read(self, seconds):
        """All answers that wait."""
        found, self.waiting = self.waiting, b""
        return found
