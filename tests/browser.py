"""A page in a browser without a window, in real time, so that its workers run:
by the browser's own protocol over a pipe."""

import base64
import fcntl
import json
import os
import shutil
import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from noslip.tests.tools import skip_without

FOUND = ("chromium", "chromium-browser", "google-chrome")
UNTIL = (
    "new Promise((done) => {{ const look = () => ({when} ? done({value}) : setTimeout(look, 50)); look(); }})"
)


class Page:
    """A tab; `faults` are what its scripts threw or wrote to the console."""

    def __init__(self, to: int, back: int):
        self._to, self._back, self._rest, self._count, self._session = to, back, b"", 0, ""
        self.faults: list[str] = []
        target = self._call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self._call("Runtime.enable")

    def open(self, address: str) -> None:
        """Load a page, with its scripts."""
        self._call("Page.navigate", url=address)
        while not self.value("document.readyState === 'complete' && location.protocol !== 'about:'"):
            time.sleep(0.05)

    def value(self, expression: str) -> Any:
        """Return the value of an expression in the page; of a promise, when it is there."""
        answer = self._call("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def until(self, when: str, value: str = "true") -> Any:
        """Return a value when a condition holds."""
        return self.value(UNTIL.format(when=when, value=value))

    def resize(self, width: int, height: int) -> None:
        """Show the page on a screen of another size, in pixels; a narrow one is a phone's."""
        self._call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 600,
        )

    def printed(self) -> bytes:
        """Return the page as it is printed, a PDF."""
        return base64.b64decode(self._call("Page.printToPDF", preferCSSPageSize=True)["data"])

    def _call(self, method: str, **arguments: Any) -> Any:
        self._count += 1
        session = {"sessionId": self._session} if self._session else {}
        os.write(
            self._to,
            json.dumps({"id": self._count, "method": method, "params": arguments, **session}).encode()
            + b"\0",
        )
        while True:
            while b"\0" not in self._rest:
                part = os.read(self._back, 1 << 20)
                assert part, "the browser has ended"
                self._rest += part
            line, _, self._rest = self._rest.partition(b"\0")
            message = json.loads(line)
            if message.get("method") in ("Runtime.exceptionThrown", "Runtime.consoleAPICalled"):
                self.faults.append(json.dumps(message["params"]))
            if message.get("id") == self._count:
                assert "error" not in message, message
                return message["result"]


@contextmanager
def browser(folder: Path) -> Iterator[Page]:
    """A tab of a browser that keeps its files in a folder; skips the test where there is no browser."""
    program = next((path for name in FOUND if (path := shutil.which(name))), None)
    if program is None:
        skip_without(FOUND[:1])
    (theirs_in, to), (back, theirs_out) = os.pipe(), os.pipe()
    command = [
        program,
        "--headless",
        "--no-sandbox",
        "--remote-debugging-pipe",
        f"--user-data-dir={folder / 'browser'}",
    ]
    # None of them is 3 or 4
    ends = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (theirs_in, theirs_out)]
    actions = [(os.POSIX_SPAWN_DUP2, end, number) for number, end in enumerate(ends, 3)]
    quiet = (os.POSIX_SPAWN_OPEN, 2, os.devnull, os.O_WRONLY, 0)
    process = os.posix_spawn(program, command, os.environ, file_actions=[*actions, quiet])
    for end in (theirs_in, theirs_out, *ends):
        os.close(end)
    try:
        yield Page(to, back)
    finally:
        os.kill(process, signal.SIGTERM)
        os.waitpid(process, 0)
        os.close(to)
        os.close(back)
