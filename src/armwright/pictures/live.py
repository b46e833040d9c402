"""Live page of an arm, moved by a program: served to local browsers over HTTP and server-sent events.  [Hickson2015]

The socket is bound to 127.0.0.1, so that no other machine reaches it. Pages of other sites that run in a browser of this one do:
they are kept out by a random token in the address, and by the headers Host and Origin, which a browser fills in itself (a name
that an attacker's DNS points at 127.0.0.1 stays in Host).  [JacksonEtAl2009]

| request       | answer                                                                                   |
|---------------|------------------------------------------------------------------------------------------|
| GET  TOKEN/   | the page of `armwright show ARM -o arm.html`, which also follows these events             |
| GET  events   | page, its number, and q; or t and q of a motion: the latest one, then each that follows   |
| POST q        | q of the page's sliders, and from, the page itself, which does not follow this one        |
"""

from __future__ import annotations

import json
import os
import secrets
import socketserver
import sys
import threading
from collections.abc import Mapping
from http.server import BaseHTTPRequestHandler
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

import numpy as np

from armwright.entry import AnyArm, as_arm
from armwright.errors import ArmwrightError, OutputError, Problem
from armwright.model import Model
from armwright.pictures.posed_arm import checked_pose, posed_arm
from armwright.pictures.scene import pose_page

if TYPE_CHECKING:
    import xarray as xr
    from numpy.typing import ArrayLike

LOOPBACK = "127.0.0.1"
PORTS = range(65536)
PATIENCE = 10.0  # [s] for a browser to send its request, or to take what it asked for
HEARTBEAT = 15.0  # [s] between events that say nothing, which find out whether a browser is still there
LONGEST = 100_000  # bytes of a pose that a page reports
FRAMES = 60.0  # [1/s] rows of a motion that a page plays, at most
MOST_FRAMES = 20_000  # of a motion
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; connect-src 'self'; "
    "img-src data:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    "Referrer-Policy": "no-referrer",
    "X-Content-Type-Options": "nosniff",
}


class LiveArm:
    """An arm in a local browser page, moved by the program; a context manager, which closes it.

    Attributes:
        url: address of the page, for browsers of this machine.   arm: the arm that it shows.
        notes: visuals that are drawn in another way than the record has them.
    """

    def __init__(self, arm: AnyArm, q: Any = None, port: int = 0):
        """Starts to serve the page.

        Args:
            arm: the arm.   q: (n,) [rad | m] the pose; by default 0.   port: of 127.0.0.1; 0: one that is free.
        Raises:
            ShapeError: q is no pose of the arm.   OutputError: the port is in use, not allowed, or no port.
        """
        self._changed = threading.Condition()
        self._closed = False
        self._news = self._pages = 0  # how many messages there were, and pages of arms
        self._draw(as_arm(arm), q)
        self._server = _serve(self, port)
        self.url = f"http://{LOOPBACK}:{self._server.port}/{self._server.token}/"
        self._thread = threading.Thread(target=self._server.serve_forever, args=(0.1,), name=self.url, daemon=True)
        self._thread.start()

    def __repr__(self) -> str:
        return f"LiveArm({self.arm.name!r}, {'closed' if self._closed else self.url})"

    def __enter__(self) -> LiveArm:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()

    @property
    def q(self) -> np.ndarray:
        """(n,) [rad | m] the pose last set by the program or by a user of the page's sliders. May be assigned."""
        return self._q.copy()

    @q.setter
    def q(self, q: ArrayLike) -> None:
        self.update(q)

    def update(self, q: Any) -> None:
        """Moves the arm in the page.

        Args:
            q: (n,) [rad | m].
        Raises:
            ShapeError: q is no pose of the arm.
        """
        self._send_pose(checked_pose(self.arm, q))

    def play(self, run: xr.Dataset, *, lane: int | None = None) -> None:
        """Plays a run in the page, in real time, and returns at once; `q` becomes that of its last row.

        Args:
            run: what `simulate` returned, of this arm.   lane: which of the run's lanes; needed where there are several.
        Raises:
            RunError: no run, a run of another arm, several lanes and none chosen, rows that are no finite numbers.
        """
        from armwright.pictures.animate import drawable_motions, one_lane
        from armwright.results.recording import in_order

        t, motions = drawable_motions(one_lane(in_order(run), lane), self.arm)
        count = int(min(FRAMES * (t[-1] - t[0]), MOST_FRAMES, len(t) - 1)) + 1
        rows = np.unique(np.searchsorted(t, np.linspace(t[0], t[-1], count)).clip(max=len(t) - 1))
        rows = np.unique([0, *rows, len(t) - 1])
        q = motions["run"]
        self._send_pose(q[-1], {"t": np.round(t[rows], 6).tolist(), "q": np.round(q[rows], 6).tolist()})

    def show(self, arm: Model, q: Any = None) -> None:
        """Shows another arm in the same page, or this one in another pose.

        Args:
            arm: the arm.   q: (n,) [rad | m] the pose; by default 0.
        Raises:
            ShapeError: q is no pose of the arm.
        """
        if arm is self.arm:
            self.update(np.zeros(arm.n) if q is None else q)
        else:
            self._draw(arm, q)

    def open(self) -> bool:
        """Opens the page in the default browser; False if no browser was found."""
        import webbrowser

        return webbrowser.open(self.url)

    def wait(self) -> None:
        """Waits until the page's server is closed; Ctrl-C raises KeyboardInterrupt as usual."""
        while self._thread.is_alive():
            self._thread.join(0.5)  # without a time Windows would not see Ctrl-C

    def close(self) -> None:
        """Ends the server and frees its port; open pages stay, and show that the program has ended."""
        with self._changed:
            if self._closed:
                return
            self._closed = True
            self._changed.notify_all()
        self._server.shutdown()
        self._server.server_close()
        self._thread.join()

    def _draw(self, arm: Model, q: Any) -> None:
        q = np.zeros(arm.n) if q is None else checked_pose(arm, q)
        posed = posed_arm(arm, q)
        text = pose_page(posed, self._pages + 1).encode("utf-8")
        with self._changed:
            self.arm: Model = arm
            self.notes: tuple[Problem, ...] = posed.notes
            self._page = text
            self._pages += 1
        self._send_pose(q)

    def _send_pose(self, q: np.ndarray, more: Mapping[str, Any] = MappingProxyType({})) -> None:
        """Sets the pose, and sends it to all pages, with more, which may replace it."""
        with self._changed:
            self._q = q.astype(float)
            self._message = json.dumps({"page": self._pages, "q": self._q.tolist(), **more}, separators=(",", ":"))
            self._news += 1
            self._changed.notify_all()

    def _next(self, seen: int) -> tuple[int, str | None]:
        """Number and text of the latest message once it is another one; no text to say nothing for now. -1: it is closed."""
        with self._changed:
            self._changed.wait_for(lambda: self._closed or self._news != seen, HEARTBEAT)
            if self._closed:
                return -1, None
            return self._news, self._message if self._news != seen else None


class _Server(socketserver.ThreadingTCPServer):
    """Not http.server's HTTPServer, which asks DNS for this machine's name."""

    daemon_threads = True
    allow_reuse_address = os.name != "nt"  # Windows would let two servers have one port

    def __init__(self, live: LiveArm, port: int):
        self.live, self.token = live, secrets.token_hex(16)
        super().__init__((LOOPBACK, port), _Handler)
        self.port: int = self.server_address[1]
        self.hosts = [f"{name}:{self.port}".removesuffix(":80") for name in (LOOPBACK, "localhost")]  # as browsers do

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Ignores errors of browsers that disconnect."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


def _serve(live: LiveArm, port: int) -> _Server:
    if isinstance(port, bool) or not isinstance(port, int) or port not in PORTS:
        raise OutputError(place="port", value=port, expected=f"0 to {PORTS[-1]}; 0 is one that is free")
    try:
        return _Server(live, port)
    except OSError as error:
        what = (error.strerror or str(error)).lower()
        raise OutputError(what, place="port", value=port, expected="another one; 0 is one that is free") from None


class _Handler(BaseHTTPRequestHandler):
    """Answers one request, and closes the connection."""

    server: _Server  # type: ignore[assignment]
    timeout = PATIENCE
    server_version, sys_version = "Armwright", ""

    def do_GET(self) -> None:
        asked = self._asked()
        if asked == "":
            self._answer("text/html; charset=utf-8", self.server.live._page)
        elif asked == "events":
            self._events()
        elif asked is not None:
            self.send_error(404)

    def do_POST(self) -> None:
        asked = self._asked()
        if asked != "q":
            if asked is not None:
                self.send_error(404)
            return
        try:
            length = int(self.headers.get("Content-Length", ""))
            if not 0 <= length <= LONGEST:
                raise ValueError
            said = json.loads(self.rfile.read(length))
            live = self.server.live
            live._send_pose(checked_pose(live.arm, said["q"]), {"from": str(said.get("from", ""))[:40]})
        except (ArmwrightError, ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError):
            self.send_error(400)
            return
        self._answer("text/plain", b"")

    def _asked(self) -> str | None:
        """Path behind the token in the address; None after an error, which is sent."""
        hosts, host, origin = self.server.hosts, self.headers.get("Host"), self.headers.get("Origin")
        if host not in hosts or (origin is not None and origin != f"http://{host}"):
            self.send_error(403, f"only for http://{hosts[0]}")
            return None
        token, slash, asked = self.path.removeprefix("/").partition("/")
        if not slash or not secrets.compare_digest(token.encode(), self.server.token.encode()):
            self.send_error(404)
            return None
        return asked

    def _events(self) -> None:
        self._head("text/event-stream")
        seen = 0
        while seen >= 0:
            seen, message = self.server.live._next(seen)
            self.wfile.write(b":\n\n" if message is None else f"data: {message}\n\n".encode())

    def _head(self, kind: str) -> None:
        self.send_response(200)
        for name, value in {"Content-Type": kind, **HEADERS}.items():
            self.send_header(name, value)
        self.end_headers()

    def _answer(self, kind: str, content: bytes) -> None:
        self._head(kind)
        self.wfile.write(content)

    def log_message(self, format: str, *arguments: Any) -> None:
        """Logs nothing: the terminal belongs to the program."""
