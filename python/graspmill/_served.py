"""A planner behind an address, as GraspGen-X's and DexGraspNet 2's servers have it (``POST /predict``, contract 0.1.0), as a
function for :func:`graspmill.experiment`. It is asked about one object after the other, with the true segmentation."""

import base64
import hashlib
import http.client
import json
import math
import socket
import string
import struct
import threading
from contextlib import suppress
from typing import Any
from urllib.parse import quote, urljoin, urlsplit

import numpy as np
from numpy.typing import NDArray

from . import _arrays
from .errors import InputError, OutsideError
from .experiments import Look, NoAnswer
from .grippers import Gripper

#: Most grasps of an object that are asked for.
GRASPS = 100
#: Fewest points of an object that is asked about, if a server does not say; most points of a request.
POINTS_MIN, POINTS_MAX = 128, 65_536
ANSWER_BYTES_MAX = 64 << 20
#: The rows of a rotation, and a server's axes, have length 1 and are at right angles but for this.
RIGID = 0.02
#: Grasps nearer to each other than this, turned by no more than that, are alike, half a turn apart or not.
ALIKE_M, ALIKE_COS = 0.01, math.cos(math.radians(30))
#: Grippers that open as wide but for this may be the same.
OPENS_ALIKE_M = 0.001
#: What reading JSON of strangers raises.
_ODD = (ValueError, TypeError, LookupError, AttributeError, ArithmeticError, RecursionError)


class ServedPlanner:
    """Asks a server, first what it is, and waits no longer for an answer than ``patience_s``. ``tip_depth_m`` is from a grasp's
    origin along its approach to the end of the finger tips; by default what ``/config`` says."""

    def __init__(self, url: str, patience_s: int, tip_depth_m: float | None = None) -> None:
        self._name, self._url = f"--planner {url}", quote(url, safe=string.punctuation)
        self._patience_s = _arrays.whole("--planner-timeout-s", patience_s, 1, 3600)
        rule = f"{self._name}: must be an address that begins with http:// or https://, such as http://127.0.0.1:8000/predict"
        with _arrays.read_as(rule, url):
            parts = urlsplit(self._url)
            self._server = parts.hostname or "", parts.port
        _arrays.must(parts.scheme in ("http", "https") and parts.hostname, rule)
        self._kind = http.client.HTTPSConnection if parts.scheme == "https" else http.client.HTTPConnection
        self._has_config = False
        text = self._config()
        self._has_config, text = bool(text), text or b"{}"
        try:
            said = {key: value for key, value in json.loads(text).items() if value is not None}
            approach, jaw = _numbers(said.get("approach_axis_local", [1, 0, 0]), 3), _numbers(said.get("jaw_axis_local", [0, 1, 0]), 3)
            # Half of a request is of the object.
            self._points_min = int(_arrays.number("min_points", _numbers(said.get("min_points", POINTS_MIN)), 0, POINTS_MAX // 2))
            points_max = _arrays.number("max_points", _numbers(said.get("max_points", POINTS_MAX)), 2, 1e12)
            self._points_max, tips_m = min(int(points_max), POINTS_MAX), np.float32(0)
            if tip_depth_m is None:
                depth, offset = (_arrays.number(key, _numbers(said.get(key, 0)), -1, 1) for key in ("fingertip_depth", "tcp_offset"))
                tips_m = np.float32(depth) - np.float32(offset)
            opens_m, self._hand = said.get("gripper_max_width"), said.get("gripper", said.get("hand"))
            self._opens_m = _numbers(opens_m) if type(opens_m) in (int, float) else math.nan
        except _ODD as error:
            raise InputError(f"{self._name}: /config must be JSON as the contract has it: {error}") from error
        if tip_depth_m is not None:
            tips_m = np.float32(_arrays.number("--tip-depth", tip_depth_m, -1, 1))
        elif "fingertip_depth" not in said:
            raise InputError(f"{self._name}: its /config does not say where the finger tips are (fingertip_depth): give --tip-depth")
        # Our axes (z approaches, y closes) in the server's.
        self._axes, self._tips_m = np.column_stack([np.cross(jaw, approach), jaw, approach]), approach * tips_m
        if not _are_rotations(self._axes[None])[0]:
            raise InputError(f"{self._name}: /config must have unit axes at right angles: approach_axis_local, jaw_axis_local")
        self._is_ours = said.get("backend") == "graspmill"
        opens = "" if math.isnan(self._opens_m) else f", which opens {self._opens_m:g} m"
        self._for = f"for {'a gripper' if self._hand is None else f'the gripper {_arrays.shown(self._hand)}'}{opens}"
        #: Who plans, as reports say it.
        self.who = f"{url} {self._for}"
        #: What tells its results from those of another.
        self.id = f"served-{hashlib.sha256(text + struct.pack('<f', tips_m)).hexdigest()}"

    def doubt(self, gripper: Gripper) -> str | None:
        """What is wrong with the gripper that executes, if the server is known to plan for another one."""
        # False for NaN. Of other servers the names are their own.
        is_other = abs(self._opens_m - gripper.opening_m_max) > OPENS_ALIKE_M or (self._is_ours and self._hand != gripper.name)
        own = f"{gripper.name}, which opens {gripper.opening_m_max:g} m"
        return f"{self._name}: it plans {self._for}, but --set plan.gripper is {own}" if is_other else None

    def __call__(self, look: Look) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
        objects, rest = look.clouds()
        first, rows = look.cameras[0].workspace_from_camera, [np.empty((0, 9))]
        always = {"num_grasps": GRASPS, "down": look.down.tolist(), "eye_m": [0.0] * 3 if first is None else first[:3, 3].tolist()}
        for number, points in enumerate(objects):
            if len(points) >= self._points_min:
                thing = _thinned(points, self._points_max // 2)
                scene = np.concatenate([*objects[:number], *objects[number + 1 :], rest])
                clouds = {"point_cloud": thing, "scene_points": _thinned(scene, self._points_max - len(thing))}
                request = json.dumps({**{name: _encoded(cloud) for name, cloud in clouds.items()}, **always})
                rows.append(self._grasps(self._answer(request), look.gripper.opening_m_max))
        found = np.concatenate(rows)
        new = found[[not _arrays.are_alike(pose, look.failed, ALIKE_M, ALIKE_COS).any() for pose in _arrays.matrices(found[:, :7])]]
        return new[:, :7], new[:, 7], new[:, 8]

    def _grasps(self, text: bytes, opening_m: float) -> NDArray[np.float64]:
        try:
            grasps = json.loads(text)["grasps"]
            at_m = np.array([_numbers(grasp["translation"], 3) for grasp in grasps]).reshape(-1, 3)
            turns = np.array([_numbers(grasp["rotation_matrix"], 3, 3) for grasp in grasps]).reshape(-1, 3, 3)
            scores = [_numbers(grasp["score"]) for grasp in grasps]
            given = [grasp.get("gripper_width") for grasp in grasps]
            widths_m = [opening_m if width is None else _numbers(width) for width in given]
        except _ODD as error:
            raise NoAnswer(f"an answer must be the contract's: {error}") from error
        with np.errstate(all="ignore"):
            ours_m = at_m + turns @ self._tips_m
            numbers = np.column_stack([ours_m, scores, widths_m]).astype(np.float32)
            is_right = np.isfinite(numbers).all(axis=1) & _are_rotations(turns)
        if not is_right.all():
            wrong = _arrays.shown(grasps[int(is_right.argmin())])
            raise NoAnswer(f"a grasp must have a rotation and numbers that are finite in single precision, got {wrong}")
        return np.column_stack([ours_m, _arrays.quaternions(turns @ self._axes), scores, widths_m])

    def _config(self) -> bytes:
        """What it says it is; nothing of a server that never did. One that does not answer is gone, also behind a proxy that is there."""
        try:
            if not (text := self._ask(urljoin(self._url, "config"))) and self._has_config:
                raise NoAnswer("status 404")
            return text
        except NoAnswer as error:
            raise OutsideError(f"{self._name}: the server does not say what it is: {error}: /config") from error

    def _answer(self, request: str) -> bytes:
        """The answer to a request. A server that is gone ends the run; one that is there gave no answer."""
        try:
            return self._ask(self._url, request.encode())
        except NoAnswer:
            self._config()
            raise

    def _ask(self, url: str, body: bytes | None = None) -> bytes:
        """The body of an answer; of one that knows no such page nothing. Redirections are not followed."""
        connection, is_late = self._kind(*self._server, timeout=self._patience_s), threading.Event()
        try:
            connection.connect()
        except (OSError, UnicodeError) as error:
            raise OutsideError(f"{self._name}: the server cannot be reached: {error}") from error
        target = urlsplit(url)._replace(scheme="", netloc="", fragment="").geturl() or "/"

        def cut(sock: socket.socket) -> None:
            is_late.set()
            with suppress(OSError):
                socket.socket.shutdown(sock, socket.SHUT_RDWR)

        # Limits all of the answer, for a server may send a byte now and then.
        patience = threading.Timer(self._patience_s, cut, [connection.sock])
        patience.start()
        try:
            kind, headers = ("GET", {}) if body is None else ("POST", {"Content-Type": "application/json"})
            connection.request(kind, target, body, headers)
            answer = connection.getresponse()
            if len(text := answer.read(ANSWER_BYTES_MAX + 1)) > ANSWER_BYTES_MAX:
                raise NoAnswer(f"an answer must have at most {ANSWER_BYTES_MAX} bytes")
            if answer.length or is_late.is_set():
                raise http.client.IncompleteRead(text)
        except (OSError, http.client.HTTPException) as error:
            if is_late.is_set() or isinstance(error, TimeoutError):
                raise NoAnswer("no answer in time") from error
            raise NoAnswer(f"{type(error).__name__}: {error}") from error
        finally:
            patience.cancel()
            connection.close()
        if body is None and answer.status == 404:
            return b""
        if not 200 <= answer.status < 300:
            location = answer.getheader("Location")
            hint = ", is the address that of /predict?" if answer.status == 404 else ""
            moved = hint if location is None else f", moved to {location}: give that address"
            said = "".join(letter for letter in f"{moved}: {text.decode(errors='replace')}" if letter.isprintable())
            raise NoAnswer(f"status {answer.status}{said[:400]}")
        return text


def _numbers(value: Any, *shape: int) -> Any:
    """Numbers of JSON in nested lists of this shape, as an array: neither texts nor truths."""
    if not shape:
        if type(value) not in (int, float):
            raise TypeError(f"{_arrays.shown(value)} is no number")
        return float(value)
    if not isinstance(value, list) or len(value) != shape[0]:
        raise TypeError(f"{_arrays.shown(value)} is no list of {shape[0]}")
    return np.array([_numbers(part, *shape[1:]) for part in value])


def _are_rotations(turns: NDArray[np.float64]) -> NDArray[np.bool_]:
    off = np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
    return np.asarray((off < RIGID) & (np.linalg.det(turns) > 0))


def _thinned(points: NDArray[np.float32], count_max: int) -> NDArray[np.float32]:
    return points[:: max(-(-len(points) // max(count_max, 1)), 1)]


def _encoded(points: NDArray[np.float32]) -> dict[str, Any]:
    return {"dtype": "float32", "shape": list(points.shape), "data_b64": base64.b64encode(points.astype("<f4").tobytes()).decode()}
