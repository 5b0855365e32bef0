"""A running `graspmill serve`, requests for tests, and the required form of its errors."""

import base64
import http.client
import io
import json
import re
import signal
import socket
import subprocess
import tomllib
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
from PIL import Image
from programs import ROOT, program

from crosscheck.pose import rotation_of

DEMO = ROOT / "planner" / "demo"
JSON = {"Content-Type": "application/json"}


class Service:
    def __init__(self, folder, *args):
        self.log = folder / "log.txt"
        command = [str(word) for word in (program("graspmill"), "serve", "--port", "0", *args)]
        with open(self.log, "w") as log:
            self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True)
        line = self.process.stdout.readline()
        found = re.fullmatch(r"listening on http://127\.0\.0\.1:(\d+)\n", line)
        assert found, f"{line!r}: {self.log.read_text()}"
        self.port = int(found[1])

    def ask(self, method, path, body=None, headers=None):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60)
        try:
            connection.request(method, path, body, headers or {})
            answer = connection.getresponse()
            return answer.status, dict((name.lower(), value) for name, value in answer.getheaders()), answer.read()
        finally:
            connection.close()

    def plan(self, request):
        body = request if isinstance(request, bytes) else json.dumps(request).encode()
        return self.ask("POST", "/v1/plan", body, JSON)

    def raw(self, data, wait_s=20.0):
        """All that comes back when these bytes are sent; nothing if the connection is closed without an answer."""
        with socket.create_connection(("127.0.0.1", self.port), timeout=wait_s) as stream:
            got = b""
            with suppress(OSError):
                stream.sendall(data)
                stream.shutdown(socket.SHUT_WR)
            with suppress(ConnectionError):
                while piece := stream.recv(65536):
                    got += piece
            return got

    def memory_kb(self, name):
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(rf"^{name}:\s+(\d+) kB", status, re.MULTILINE)[1])

    def end(self):
        self.process.send_signal(signal.SIGTERM)
        code = self.process.wait(30)
        self.process.stdout.close()
        return code


@contextmanager
def running(folder, *args):
    service = Service(folder, *args)
    try:
        yield service
    finally:
        if service.process.poll() is None:
            service.process.kill()
            service.process.wait()
        service.process.stdout.close()


def demo_view():
    """The demo's first view: depth in metres (height, width), the lens, the camera's pose."""
    request = tomllib.loads((DEMO / "views.toml").read_text())
    view = request["views"][0]
    depth_m = np.asarray(Image.open(DEMO / view["depth"])) * np.float32(view["depth_scale_m"])
    return depth_m.astype(np.float32), view.get("intrinsics", request.get("intrinsics")), view["workspace_from_camera"]


def demo_request():
    """planner/demo/views.toml with the images in place of their paths."""
    request = tomllib.loads((DEMO / "views.toml").read_text())
    for view in request["views"]:
        view["depth"] = file_of((DEMO / view["depth"]).read_bytes())
    return request


def file_of(data):
    return {"data": base64.b64encode(data).decode()}


def matrix(pose):
    made = np.eye(4)
    made[:3, :3], made[:3, 3] = rotation_of(pose["quaternion_xyzw"]), pose["position_m"]
    return made


def npy(array):
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


def seen(depth_m=None, width=64, height=48):
    """The view of a camera 0.6 m above the workspace's centre, looking down on a bare table at 0.05 m."""
    depth_m = np.full((height, width), 0.55, np.float32) if depth_m is None else depth_m
    height, width = depth_m.shape[:2]
    return {
        "depth": file_of(npy(depth_m)),
        "intrinsics": {"fx_px": 80.0, "fy_px": 80.0, "cx_px": (width - 1) / 2, "cy_px": (height - 1) / 2},
        "workspace_from_camera": {"position_m": [0.15, 0.15, 0.6], "quaternion_xyzw": [1.0, 0.0, 0.0, 0.0]},
    }


def check_error(status, headers, body):
    assert 400 <= status < 600 and status != 500, (status, body)
    told = json.loads(body)
    assert headers["content-type"] == "application/json"
    assert told.keys() == {"error", "status"} and told["status"] == status and told["error"], told
    return told["error"]
