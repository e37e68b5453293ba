"""Headless Chromium, controlled through a pipe (DevTools protocol), for tests of HTML pages."""

import json
import os
import shutil
import subprocess
import time

CHROMIUM = os.environ.get("ASRSIM_CHROMIUM") or next(
    (path for name in ("chromium", "chromium-browser", "google-chrome") if (path := shutil.which(name))), None
)


class Browser:
    """A page in a headless browser. It collects console messages, exceptions and requests."""

    def __init__(self, profile):
        assert CHROMIUM is not None
        from_us, self._write = os.pipe()
        self._read, to_us = os.pipe()
        # Chromium reads commands from descriptor 3 and answers on 4.
        options = (
            "--headless=new --no-sandbox --disable-gpu --hide-scrollbars --remote-debugging-pipe --enable-unsafe-swiftshader"
        )
        command = f"exec 3<&{from_us} 4>&{to_us}; exec '{CHROMIUM}' {options} --user-data-dir='{profile}' about:blank"
        self._process = subprocess.Popen(
            ["bash", "-c", command], pass_fds=(from_us, to_us), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        )
        os.close(from_us)
        os.close(to_us)
        os.set_blocking(self._read, False)
        self._buffer = b""
        self._number = 0
        self.events = []
        targets = self.call("Target.getTargets", session=None)["targetInfos"]
        page = next(target["targetId"] for target in targets if target["type"] == "page")
        self._session = self.call("Target.attachToTarget", {"targetId": page, "flatten": True}, session=None)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.call(f"{domain}.enable")

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        self._process.terminate()
        self._process.wait(timeout=10)
        os.close(self._read)
        os.close(self._write)

    def call(self, method, params=None, session="page"):
        """Answer to a DevTools command."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": params or {}}
        if session is not None:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        number = self._number
        answer = self._until(lambda m: m.get("id") == number)
        assert "error" not in answer, answer
        return dict(answer.get("result", {}))

    def open(self, path, *, width, height=900):
        """Load a file in a window of `width` x `height` pixels, and wait until it is loaded."""
        self.call(
            "Emulation.setDeviceMetricsOverride",
            {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600},
        )
        self.events.clear()
        self.call("Page.navigate", {"url": path.absolute().as_uri()})
        if not any(event["method"] == "Page.loadEventFired" for event in self.events):
            self._until(lambda m: m.get("method") == "Page.loadEventFired")

    def evaluate(self, expression):
        """Value of a JavaScript expression, after its promises are resolved."""
        result = self.call("Runtime.evaluate", {"expression": expression, "awaitPromise": True, "returnByValue": True})
        assert "exceptionDetails" not in result, result["exceptionDetails"]
        return result["result"].get("value")

    @property
    def complaints(self):
        """Console messages, uncaught exceptions and log entries of the page."""
        said = []
        for event in self.events:
            params = event.get("params", {})
            if event["method"] == "Runtime.consoleAPICalled":
                said.append(f"{params['type']}: {[a.get('value') for a in params['args']]}")
            elif event["method"] == "Runtime.exceptionThrown":
                said.append(str(params["exceptionDetails"]))
            # A missing graphics card is not a fault of the page.
            elif event["method"] == "Log.entryAdded" and "GPU stall" not in params["entry"]["text"]:
                said.append(params["entry"]["text"])
        return said

    @property
    def requests(self):
        """Addresses that the page requested, without data addresses."""
        urls = [e["params"]["request"]["url"] for e in self.events if e["method"] == "Network.requestWillBeSent"]
        return [url for url in urls if not url.startswith("data:")]

    def _until(self, wanted, patience=30.0):
        end = time.monotonic() + patience
        while time.monotonic() < end:
            while b"\0" in self._buffer:
                text, self._buffer = self._buffer.split(b"\0", 1)
                message = json.loads(text)
                if "method" in message:
                    self.events.append(message)
                if wanted(message):
                    return dict(message)
            try:
                self._buffer += os.read(self._read, 1 << 20)
            except BlockingIOError:
                time.sleep(0.01)
        raise TimeoutError("the browser does not answer")
