"""A command as a terminal starts it, also where the tests themselves run in the background with Ctrl-C ignored.

Said to the command by a line of Python that becomes it, not by `preexec_fn`: that would fork a process whose libraries
(JAX) have threads, and warn of them.
"""

import sys

_LINE = """
import os, signal, sys
for number in (signal.SIGINT, signal.SIGHUP):
    signal.signal(number, signal.SIG_DFL)
if os.isatty(0) and os.getsid(0) == os.getpid():
    import fcntl, termios
    fcntl.ioctl(0, termios.TIOCSCTTY, 0)
os.execv(sys.argv[1], sys.argv[1:])
"""
FOREGROUND = (sys.executable, "-c", _LINE)
