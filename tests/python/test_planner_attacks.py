"""Hostile and faulty clients of `graspmill serve`. A malformed request is a function that returns a body's bytes, and
whether it must be refused: one with a flipped bit may be right. `planner/src/input` damages images and clouds."""

import json
import random
import socket
import struct
import zlib
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager

import pytest

from mutations import leaves
from programs import changed
from planner_service import check_error, demo_request, file_of, running, seen


@pytest.fixture(scope="module")
def service(tmp_path_factory):
    with running(tmp_path_factory.mktemp("service"), "--queue", "8") as service:
        yield service


def changed_somewhere(chance, value):
    request = {"views": [seen()]}
    return json.dumps(changed(request, ".".join(map(str, chance.choice(list(leaves(request))))), value))


def random_bytes(chance):
    return chance.randbytes(chance.randrange(2000)), True


def cut_json(chance):
    body = json.dumps({"views": [seen()]}).encode()
    return body[: chance.randrange(len(body))], True


def flipped_json(chance):
    body = bytearray(json.dumps({"views": [seen()]}).encode())
    for _ in range(chance.randrange(1, 20)):
        body[chance.randrange(len(body))] = chance.randrange(256)
    return bytes(body), False


def wrong_type(chance):
    return changed_somewhere(chance, chance.choice([True, "x", "", {"a": 1}, [[]], {}, [None]])).encode(), True


def deep(chance):
    opening, depth = chance.choice(["[", '{"views":', '[{"a":']), chance.choice([100, 10_000, 500_000])
    return opening.encode() * depth, True


def deep_inside(chance):
    text, depth = changed_somewhere(chance, "@@"), chance.choice([50, 5_000, 200_000])
    return text.replace('"@@"', "[" * depth + "]" * depth).encode(), True


def huge_promise(chance):
    """A header that declares far more data than present."""
    side = chance.choice([4096, 100_000, 2**31 - 1])
    head = struct.pack(">IIBBBBB", side, side, 16, 0, 0, 0, 0)
    checked = b"IHDR" + head
    image = b"\x89PNG\r\n\x1a\n" + struct.pack(">I", 13) + checked + struct.pack(">I", zlib.crc32(checked))
    told = f"{{'descr': '<f4', 'fortran_order': False, 'shape': ({side}, {side}), }}".ljust(117).encode() + b"\n"
    array = b"\x93NUMPY\x01\x00" + struct.pack("<H", len(told)) + told
    return json.dumps({"views": [seen() | {"depth": file_of(chance.choice([image, array]))}]}).encode(), True


BODIES = [random_bytes, cut_json, flipped_json, wrong_type, deep, deep_inside, huge_promise]


def broken_http(chance):
    body = json.dumps({"views": [seen(width=4, height=4)]}).encode()
    head = b"POST /v1/plan HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\nContent-Type: application/json\r\n"
    chunked = head + b"Transfer-Encoding: chunked\r\n\r\n"
    return chance.choice([
        head + b"\r\n" + body,
        head + b"Content-Length: -1\r\n\r\n" + body,
        head + b"Content-Length: 99999999999999999999\r\n\r\n" + body,
        head + b"Content-Length: 10\r\nContent-Length: 20\r\n\r\n" + body,
        head + b"Content-Length: %d\r\n\r\n" % (len(body) + 50) + body,
        head + b"Content-Length: 70000000\r\n\r\n" + body,
        chunked + b"zz\r\n" + body,
        chunked + b"ffffffffffffffffff\r\n" + body,
        chunked + b"10\r\n" + body,
        chunked + chance.randbytes(200),
        b"POST /v1/plan HTTP/9.9\r\n\r\n",
        b"POST\r\n\r\n",
        b"GET " + b"/" * 70_000 + b" HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"GET / HTTP/1.1\r\n" + b"".join(b"h%d: x\r\n" % n for n in range(200)) + b"\r\n",
        b"GET / HTTP/1.1\r\nHost: localhost\r\na: " + b"b" * 500_000 + b"\r\n\r\n",
        b"GET /\xff\xfe HTTP/1.1\r\nHost: localhost\r\n\r\n",
        b"\x16\x03\x01\x02\x00\x01\x00\x01\xfc\x03\x03" + chance.randbytes(100),
        b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + chance.randbytes(100),
        b"\0" * 300,
        b"",
        chance.randbytes(500),
    ])  # fmt: skip


def check_raw(got):
    """A whole answer 4xx/5xx, but not 500, or nothing. What cannot be parsed as HTTP is refused without a body."""
    if not got.startswith(b"HTTP/"):
        assert not got or not got.isascii() or b"HTTP" not in got, got[:200]
        return "closed"
    head, _, body = got.partition(b"\r\n\r\n")
    status = int(head.split(b" ")[1])
    assert 400 <= status < 600 and status != 500, got[:300]
    if body:
        assert json.loads(body)["status"] == status
    return status


def leave_early(service, chance):
    body = json.dumps({"views": [seen()]}).encode()
    head = b"POST /v1/plan HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: %d\r\n\r\n"
    request = head % len(body) + body
    with socket.create_connection(("127.0.0.1", service.port), timeout=20) as stream:
        stream.sendall(request[: chance.randrange(len(request) + 1)])
        if chance.random() < 0.5:
            stream.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))


@contextmanager
def slow_heads(service, count):
    """Connections that never complete their header. `planner/src/serve/tests.rs` waits until they are hung up on."""
    streams = [socket.create_connection(("127.0.0.1", service.port), timeout=30) for _ in range(count)]
    for number, stream in enumerate(streams):
        stream.sendall(b"POST /v1/plan HTTP/1.1\r\nHost: localhost\r\n"[: number + 1])
    try:
        yield
    finally:
        for stream in streams:
            stream.close()


def test_malformed_requests_and_it_plans_as_before(service, factor):
    good = demo_request()
    before = service.plan(good)[2]
    assert json.loads(before)["grasps"]
    chance = random.Random(7)
    statuses = Counter()
    with slow_heads(service, 20):
        for number in range(60 * factor):
            way = BODIES[number % len(BODIES)]
            body, must_be_refused = way(chance)
            status, headers, told = service.plan(body)
            statuses[status] += 1
            if status == 200:
                assert not must_be_refused, (way.__name__, body[:2000])
                json.loads(told)
            else:
                assert status in (400, 422), (way.__name__, status, told[:300])
                check_error(status, headers, told)
        for _ in range(20 * factor):
            statuses[f"raw {check_raw(service.raw(broken_http(chance)))}"] += 1
        for _ in range(8 * factor):
            leave_early(service, chance)
        with ThreadPoolExecutor(50) as pool:
            bodies = [chance.choice(BODIES)(chance)[0] for _ in range(50)]
            for status, headers, told in pool.map(service.plan, bodies):
                statuses[status] += 1
                if status != 200:
                    check_error(status, headers, told)
    print(f"answers: {dict(statuses)}; VmHWM {service.memory_kb('VmHWM')} kB, VmRSS {service.memory_kb('VmRSS')} kB")
    # Some requests must be answered and some refused.
    assert statuses[422] > 15 * factor and statuses[400] > 4 * factor, statuses
    assert service.process.poll() is None, service.log.read_text()[-3000:]
    assert service.plan(good)[2] == before
    assert service.memory_kb("VmHWM") < 2_000_000
    # As many as are planned and wait; each try takes as long as plans of clients that are gone may still take.
    with ThreadPoolExecutor(10) as pool:
        tries = ({status for status, _, _ in pool.map(lambda _: service.plan(good), range(10))} for _ in range(20))
        assert {200} in tries, "requests of clients that are gone still have their places"
    assert "panicked" not in service.log.read_text()


def test_long_lists_cost_no_memory(tmp_path):
    """Lists of which each entry would take more memory than the bytes that ask for it."""

    def many(before, entry, after):
        return before + (entry + b",") * (18_000_000 // (len(entry) + 1)) + entry + after

    attacks = {
        "under an unknown key": (many(b'{"x":[', b"0", b"]}"), ": x"),
        "empty eyes": (many(b'{"eyes_m":[', b"[]", b"]}"), ": eyes_m[0]"),
        "many eyes": (many(b'{"eyes_m":[', b"[0,0,1]", b"]}"), "at most 32 entries, got 2250001: eyes_m"),
        "a long eye": (many(b'{"eyes_m":[[', b"0", b"]]}"), "got 9000001: eyes_m[0]"),
        "many views": (many(b'{"views":[', b'{"depth":""}', b"]}"), ": views"),
        "a long matrix": (many(b'{"base_from_workspace":[', b"[0,0,0,0]", b"]}"), ": base_from_workspace"),
        "a long quaternion": (many(b'{"workspace_from_wrist":{"quaternion_xyzw":[', b"0", b"]}}"), ".quaternion_xyzw"),
        "no object": (many(b"[", b"0", b"]"), ""),
        "deep": (b"[" * 10_000_000 + b"]" * 10_000_000, ""),
        "a long key": (b'{"' + b"x" * 18_000_000 + b'":0}', "unknown field"),
    }
    with running(tmp_path) as service:
        for name, (body, place) in attacks.items():
            status, headers, told = service.plan(body)
            assert status == 422, (name, status, told[:300])
            assert place in check_error(status, headers, told) and len(told) < 2000, (name, told[:600])
        with ThreadPoolExecutor(8) as pool:
            answers = list(pool.map(service.plan, (body for body, _ in attacks.values())))
        assert {status for status, _, _ in answers} == {422}
        print(f"VmHWM {service.memory_kb('VmHWM')} kB")
        assert service.memory_kb("VmHWM") < 1_000_000
        assert service.plan({"views": [seen()]})[0] == 200
