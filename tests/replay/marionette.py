"""Firefox without its driver, which no package registry of CI has: selenium's commands by Firefox's own protocol
(https://firefox-source-docs.mozilla.org/testing/marionette/Protocol.html), whose commands are those of WebDriver."""

import json
import os
import socket
import subprocess
import time
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.common.exceptions import WebDriverException
from selenium.webdriver.remote.client_config import ClientConfig
from selenium.webdriver.remote.errorhandler import ErrorHandler
from selenium.webdriver.remote.remote_connection import RemoteConnection

START_S = 60.0
COMMANDS = {
    "newSession": "WebDriver:NewSession",
    "get": "WebDriver:Navigate",
    "refresh": "WebDriver:Refresh",
    "getCurrentUrl": "WebDriver:GetCurrentURL",
    "findElement": "WebDriver:FindElement",
    "findElements": "WebDriver:FindElements",
    "findChildElements": "WebDriver:FindElements",
    "clickElement": "WebDriver:ElementClick",
    "getElementText": "WebDriver:GetElementText",
    "getElementAttribute": "WebDriver:GetElementAttribute",
    "getElementValueOfCssProperty": "WebDriver:GetElementCSSValue",
    "getElementTagName": "WebDriver:GetElementTagName",
    "getElementRect": "WebDriver:GetElementRect",
    "sendKeysToElement": "WebDriver:ElementSendKeys",
    "isElementSelected": "WebDriver:IsElementSelected",
    "isElementEnabled": "WebDriver:IsElementEnabled",
    "w3cExecuteScript": "WebDriver:ExecuteScript",
    "w3cExecuteScriptAsync": "WebDriver:ExecuteAsyncScript",
    "actions": "WebDriver:PerformActions",
    "setWindowRect": "WebDriver:SetWindowRect",
    "setTimeouts": "WebDriver:SetTimeouts",
    "screenshot": "WebDriver:TakeScreenshot",
    "setContext": "Marionette:SetContext",
    "quit": "Marionette:Quit",
}
"""Of selenium, and what Firefox calls them."""
PREFER = """
const [name, value] = arguments;
if (typeof value === "number") Services.prefs.setIntPref(name, value); else Services.prefs.setStringPref(name, value);
"""


class Marionette(RemoteConnection):
    """The connection of a selenium driver to a Firefox that listens on a port of this machine."""

    def __init__(self, port: int) -> None:
        super().__init__(client_config=ClientConfig(remote_server_addr=f"http://127.0.0.1:{port}"))
        self._socket = socket.create_connection(("127.0.0.1", port), timeout=START_S)
        self._stream = self._socket.makefile("rwb")
        self._number = 0
        self._receive()  # a greeting

    def execute(self, command: str, params: dict[str, Any]) -> dict[str, Any]:
        """Send one command of selenium and wait for its answer, as selenium's drivers give it."""
        if command not in COMMANDS:
            raise WebDriverException(f"{command}: add it to COMMANDS")
        words = {name: value for name, value in params.items() if name != "sessionId"}
        if command == "findChildElements":
            words["element"] = words.pop("id")
        if command == "quit":
            words = {"flags": ["eForceQuit"]}
        self._number += 1
        text = json.dumps([0, self._number, COMMANDS[command], words]).encode()
        self._stream.write(b"%d:%s" % (len(text), text))
        self._stream.flush()
        _, _, error, result = self._receive()
        if error is not None:
            return {"status": 500, "value": json.dumps({"value": error})}
        # Values come alone or as {"value": …}, rectangles, sessions and lists as they are.
        inner = result["value"] if isinstance(result, dict) and result.keys() == {"value"} else result
        return {"value": inner}

    def close(self) -> None:
        """End the connection."""
        self._stream.close()
        self._socket.close()

    def _receive(self) -> Any:
        size = b""
        while (byte := self._stream.read(1)) not in (b":", b""):
            size += byte
        return json.loads(self._stream.read(int(size)))


class Firefox(webdriver.Remote):
    """A Firefox without a screen, with a profile in the empty folder `profile`."""

    def __init__(self, program: str, profile: Path, preferences: dict[str, Any]) -> None:
        lines = [f"user_pref({json.dumps(name)}, {json.dumps(value)});\n" for name, value in preferences.items()]
        (profile / "user.js").write_text("".join([*lines, 'user_pref("marionette.port", 0);\n']))
        command = [
            program,
            "--headless",
            "--marionette",
            "--remote-allow-system-access",
            "--no-remote",
            "--profile",
            str(profile),
        ]
        at_home = {**os.environ, "HOME": str(profile), "TMPDIR": str(profile)}  # it leaves files in both
        quiet: dict[str, Any] = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self._process = subprocess.Popen(command, env=at_home, **quiet)
        try:
            port = profile / "MarionetteActivePort"
            end = time.monotonic() + START_S
            while not (port.exists() and port.read_text()):
                if self._process.poll() is not None or time.monotonic() > end:
                    raise WebDriverException(f"{program} did not start")
                time.sleep(0.1)
            super().__init__(Marionette(int(port.read_text())), options=webdriver.FirefoxOptions())
            self.error_handler = ErrorHandler()
        except BaseException:
            self._process.kill()
            raise

    def prefer(self, name: str, value: str | int) -> None:
        """Set a preference of the running browser."""
        self.execute("setContext", {"value": "chrome"})
        try:
            self.execute_script(PREFER, name, value)
        finally:
            self.execute("setContext", {"value": "content"})

    def quit(self) -> None:
        """End the browser."""
        super().quit()
        self._process.wait(30)
