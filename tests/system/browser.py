"""Chromium without a screen, by its own DevTools protocol over a pair of pipes: no library of
anybody's is between.
"""
import base64
import contextlib
import json
import os
import shutil
import subprocess
import threading
import time

PROGRAM = shutil.which("chromium")
PATIENCE_S = 300


class Browser:
    def __init__(self, folder):
        ours, to = os.pipe()                      # what it reads; what we write
        from_, its = os.pipe()

        def place():
            """Descriptors 3 and 4, from wherever they are."""
            high = [os.dup(ours), os.dup(its)]
            os.dup2(high[0], 3)
            os.dup2(high[1], 4)
        env = {**os.environ, "HOME": str(folder), "TMPDIR": str(folder)}
        env.pop("DBUS_SESSION_BUS_ADDRESS", None)
        self.process = subprocess.Popen(
            [PROGRAM, "--headless=new", "--no-sandbox", "--disable-gpu", "--no-first-run",
             "--disable-dev-shm-usage", "--disable-extensions", "--disable-background-networking",
             "--disable-component-update", "--remote-debugging-pipe",
             f"--user-data-dir={folder}/profile", "about:blank"],
            preexec_fn=place, close_fds=False, env=env, stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(ours)
        os.close(its)
        self.to, self.of = os.fdopen(to, "wb"), os.fdopen(from_, "rb")
        self.patience = threading.Timer(PATIENCE_S, self.process.kill)
        self.patience.start()
        self.last, self.buffer, self.errors, self.session = 0, b"", [], None
        target = self.do("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.do("Target.attachToTarget", targetId=target,
                               flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self.do(f"{domain}.enable")

    def close(self):
        self.patience.cancel()
        try:
            self.session = None
            self.do("Browser.close")
        except (OSError, AssertionError):
            self.process.kill()
        self.process.wait()
        for end in (self.to, self.of):
            with contextlib.suppress(OSError):
                end.close()

    def hear(self, message):
        """What a page has to complain of."""
        method, params = message.get("method"), message.get("params", {})
        if method == "Runtime.exceptionThrown":
            self.errors.append(params["exceptionDetails"].get("exception", {}).get("description")
                               or params["exceptionDetails"]["text"])
        elif method == "Log.entryAdded" and params["entry"]["level"] == "error":
            self.errors.append(params["entry"]["text"])
        elif method == "Runtime.consoleAPICalled" and params["type"] in ("error", "assert"):
            self.errors.append(str(params["args"]))

    def do(self, method, **params):
        self.last += 1
        message = {"id": self.last, "method": method, "params": params}
        if self.session:
            message["sessionId"] = self.session
        self.to.write(json.dumps(message).encode() + b"\0")
        self.to.flush()
        while True:
            while b"\0" not in self.buffer:
                more = os.read(self.of.fileno(), 65536)
                assert more, "the browser ended"
                self.buffer += more
            text, self.buffer = self.buffer.split(b"\0", 1)
            answer = json.loads(text)
            self.hear(answer)
            if answer.get("id") == self.last:
                assert "error" not in answer, answer
                return answer["result"]

    def go(self, url):
        self.do("Page.navigate", url=url)
        self.wait("document.readyState === 'complete'")

    def ask(self, expression):
        """The value of an expression in the page."""
        answer = self.do("Runtime.evaluate", expression=expression, returnByValue=True,
                         awaitPromise=True)
        assert "exceptionDetails" not in answer, answer
        return answer["result"].get("value")

    def wait(self, expression):
        """Until the expression is true; its value."""
        end = time.monotonic() + PATIENCE_S
        while not (value := self.ask(expression)):
            assert time.monotonic() < end, (expression, self.ask("document.body.innerText"))
            time.sleep(0.05)
        return value

    def key(self, name, code=0):
        for kind in ("keyDown", "keyUp"):
            text = {"text": "\r"} if name == "Enter" and kind == "keyDown" else {}
            self.do("Input.dispatchKeyEvent", type=kind, key=name, code=name,
                    windowsVirtualKeyCode=code, **text)

    def picture(self, path):
        path.write_bytes(base64.b64decode(self.do("Page.captureScreenshot")["data"]))
