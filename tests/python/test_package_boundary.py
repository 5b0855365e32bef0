"""Where the package meets its interpreter: memory, Ctrl-C, threads, its end, what only looks like arrays or text."""

import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import numpy as np
import pytest

from grasp_sets import BOXED as scene, CAMERA as camera, DOWN, graspmill, refused
from programs import ran

SCENE = """
import itertools, os, resource, signal, sys, threading, time
import numpy as np
import graspmill
camera = graspmill.Camera.look_at((0.15, -0.2, 0.5))
scene = graspmill.Scene([graspmill.Object.cuboid((0.04, 0.06, 0.05), (0.15, 0.15, 0.075))])
"""


def told(code, before="", timeout=120, **options):
    return ran(sys.executable, "-c", before + SCENE + textwrap.dedent(code), timeout=timeout, **options).stdout


def test_no_call_ends_the_process_where_memory_ends(tmp_path, factor):
    """Each call with no more memory, or with a little; in a long run with every limit, and larger."""
    limits, side_px, points = (((0,), (150,)), 1_000, 300_000) if factor == 1 else (((0, 70, 100, 150, 200, 300, 400, 500),), 2_000, 1_000_000)
    # Without regions that its allocator keeps in advance, which would lie below every limit.
    out = told(
        f"""
        tsdf, image = scene.tsdf([camera], resolution=40), scene.render(camera)
        planner, poses = graspmill.Planner(), np.tile(np.eye(4), (1_500, 1, 1))
        dataset = graspmill.generate({str(tmp_path / "ds")!r}, attempts=120, shards=1, seed=5)
        wide = graspmill.Camera.look_at((0.15, -0.2, 0.5), width_px={side_px}, height_px={side_px})
        far, large = scene.render(wide), graspmill.Camera.look_at((0.15, -0.2, 0.5), width_px=16_384, height_px=16_384)
        bare = graspmill.Camera.from_K([[540, 0, 320], [0, 540, 240], [0, 0, 1]], (480, 640))
        rng = np.random.default_rng(1)
        corners, faces = rng.random((60, 3)) * 0.05, rng.integers(0, 60, (60, 3))
        points = rng.random(({points}, 3)) * (0.3, 0.3, 0.0) + (0.0, 0.0, 0.0501)
        plan = planner.plan(image, camera)
        calls = dict(
            execute=lambda: graspmill.execute(scene, poses[:50]),
            settle=lambda: scene.settle(),
            render=lambda: scene.render(wide),
            large=lambda: scene.render(large),
            large_grid=lambda: scene.tsdf([large]),
            fuse=lambda: graspmill.tsdf([far], [wide], resolution=160),
            crops=lambda: graspmill.grasp_crops(tsdf, poses),
            mesh=lambda: graspmill.Object.mesh((corners, faces), (0.15, 0.15, 0.1)),
            planner=lambda: graspmill.Planner("paper"),
            plan=lambda: planner.plan(image, camera),
            plan_wide=lambda: planner.plan(far, wide),
            plan_large=lambda: planner.plan(image, camera, workspace_size_m=0.9),
            plan_found=lambda: planner.plan(image, bare),
            overlay=lambda: plan.overlay(),
            accept=lambda: planner.plan(image, camera, accept=lambda _: True),
            cloud=lambda: planner.plan_cloud(points),
            plan_page=lambda: plan.page(),
            scene=lambda: dataset[0].replay(0),
            page=lambda: dataset[0].page(),
            report=lambda: dataset.report(),
            samples=lambda: dataset._native.samples(0, [0, 1], False, 0.0),
        )
        for number, (name, call) in enumerate(calls.items()):
            for more_mb in {limits}[number % {len(limits)}]:
                used = int(open("/proc/self/statm").read().split()[0]) * resource.getpagesize()
                print(name, more_mb, end=": ", flush=True)
                resource.setrlimit(resource.RLIMIT_AS, (used + (more_mb << 20), resource.RLIM_INFINITY))
                try:
                    call()
                    how = "done"
                except (MemoryError, graspmill.GraspmillError) as error:
                    how = f"{{type(error).__name__}} {{error}}"
                finally:
                    resource.setrlimit(resource.RLIMIT_AS, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
                print(how, flush=True)
        """,
        env={**os.environ, "MIMALLOC_ARENA_RESERVE": "0"},
        timeout=600,
    )
    ends = re.findall(r"^(\w+) \d+: (\w+) ?(.*)$", out, re.M)
    assert {how for _, how, _ in ends} <= {"done", "MemoryError", "OutsideError"}, out
    assert len(ends) >= 21 and [how for _, how, _ in ends].count("done") > 2, out
    said = [why for name, how, why in ends if name.startswith("large") and how == "OutsideError"]
    assert said and all(re.fullmatch(r"out of memory: \d+ bytes could not be allocated", why) for why in said), said


def test_a_function_may_wait_for_another_thread_on_one_processor():
    one = "import os\nos.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\n"
    out = told(
        """
        planner, image = graspmill.Planner(), scene.render(camera)
        found = []

        def work():
            found.append((scene.render(camera).shape, len(planner.plan(image, camera)), len(planner.plan(image, camera, accept=lambda _: True))))

        def accept(pose):
            if not found:
                thread = threading.Thread(target=work)
                thread.start()
                thread.join()
            assert threading.current_thread() is threading.main_thread()
            return True

        plan = planner.plan(image, camera, accept=accept)
        print(found[0][0], found[0][1] == found[0][2] == len(plan) > 0)
        """,
        one,
    )
    assert out == "(480, 640) True\n"


INTERRUPTED = {
    "accept": "graspmill.Planner().plan(scene.render(camera), camera, accept=lambda _: begun() or threading.Event().wait())",
    "grasp_crops": "begun(); [graspmill.grasp_crops(np.zeros((40, 40, 40)), np.tile(np.eye(4), (20_000, 1, 1))) for _ in range(50)]",
    "mesh": """
rng = np.random.default_rng(1)
mesh = rng.random((60_000, 3)) * 0.1, np.arange(60_000).reshape(-1, 3)
begun()
graspmill.Object.mesh(mesh, (0.15, 0.15, 0.1), parts_max=64)""",
    "generate": "generate",
}


@pytest.mark.parametrize("name", INTERRUPTED)
def test_ctrl_c_ends_a_call_soon_and_the_package_goes_on(name, tmp_path):
    call = INTERRUPTED[name]
    if name == "generate":
        call = f"graspmill.generate({str(tmp_path / 'ds')!r}, attempts=10**8, shards=100, progress=lambda *_: begun())"
    code = f"""
def begun():
    print("begun", flush=True)

try:
    exec({call!r}, globals())
except KeyboardInterrupt:
    print("interrupted", scene.render(camera).shape, flush=True)
os._exit(0)
"""
    process = subprocess.Popen([sys.executable, "-c", SCENE + code], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout.readline() == "begun\n"
    time.sleep(0.3)  # so that it is in the midst of its work
    process.send_signal(signal.SIGINT)
    begun = time.monotonic()
    try:
        out, err = process.communicate(timeout=30)
    finally:
        process.kill()
    assert out.endswith("interrupted (480, 640)\n"), (out[-500:], err)
    assert time.monotonic() - begun < (20.0 if name == "generate" else 8.0)  # what it finished of a scene is kept


@pytest.mark.parametrize("call", ["planner.plan(image, camera, accept=accept)", "graspmill.execute(scene, poses)", "planner.plan(image, camera)"])
def test_a_daemon_thread_that_works_does_not_break_the_interpreters_end(call):
    code = f"""
planner, image, poses = graspmill.Planner(), scene.render(camera), np.tile(np.eye(4), (50, 1, 1))
ready = threading.Event()

def accept(pose):
    ready.set()
    return sum(range(300)) > 0

def work():
    while True:
        {call}
        ready.set()

for _ in range(3):
    threading.Thread(target=work, daemon=True).start()
ready.wait()
time.sleep(float(sys.argv[1]))
"""
    for number in (0, 5):
        assert ran(sys.executable, "-c", SCENE + code, 0.013 * number, timeout=120).stderr == "", number


def test_what_only_looks_like_an_array_is_refused(planner):
    plain, released = memoryview(np.zeros((4, 4, 4), np.float32)), memoryview(b"1234")
    released.release()
    odd = memoryview(np.zeros(3, dtype="S3"))

    class Broken:
        def __array__(self, *_, **__):
            raise RuntimeError("no host copy")

    for value in ([[1.0, 2.0], [3.0]], released, odd, Broken(), b"abc", None, "ab", object()):
        refused("depth", lambda: planner.plan(value, camera))
        refused("depth", lambda: planner.plan([value], [camera]))
        refused("depth", lambda: graspmill.tsdf([value], [camera]))
        refused("mask", lambda: planner.plan(scene.render(camera), camera, mask=[value]))
        refused("points_m", lambda: planner.plan_cloud(value))
        refused("tsdf", lambda: planner.plan_tsdf(value))
        refused("grasps", lambda: graspmill.execute(scene, value))
        refused("targets", lambda: graspmill.execute(scene, [DOWN], targets=value if value is not None else "x"))
        refused("mesh", lambda: graspmill.Object.mesh((np.eye(3), value), (0, 0, 0)))
        refused("mesh", lambda: graspmill.Object.mesh((value, [[0, 1, 2]]), (0, 0, 0)))
        refused("pose", lambda: graspmill.Object.cuboid((0.1, 0.1, 0.1), value))
    for value in (plain, released, None, 3):
        refused("depth", lambda: planner.plan(value, [camera]))
        refused("mask|depth", lambda: planner.plan([scene.render(camera)], [camera], mask=value if value is not None else 3))
        refused("objects", lambda: graspmill.Scene(value))
    refused("cameras", lambda: planner.plan([scene.render(camera)], 3))
    same = memoryview(scene.render(camera))
    assert planner.plan(same, camera).to_json() == planner.plan(scene.render(camera), camera).to_json()


def test_a_masked_array_is_refused_and_the_message_says_what_to_do(planner):
    image = scene.render(camera)
    hidden = np.ma.masked_array(image, mask=image > 0.5)

    def masked(values):
        return np.ma.masked_array(values, mask=False)

    tsdf = scene.tsdf([camera])
    for call in (
        lambda: planner.plan(hidden, camera), lambda: planner.plan([hidden], [camera]),
        lambda: planner.plan(np.ma.stack([hidden]), [camera]), lambda: planner.plan(image, camera, mask=masked(image > 0.5)),
        lambda: graspmill.tsdf([hidden], [camera]), lambda: planner.plan_cloud(masked(np.zeros((3, 3)))),
        lambda: planner.plan_cloud([masked([0.1, 0.1, 0.1]), [0.1, 0.1, 0.2]]),
        lambda: planner.plan_cloud(np.zeros((3, 3)), eyes_m=masked(np.ones((1, 3)))), lambda: planner.plan_tsdf(masked(tsdf)),
        lambda: planner.plan_tsdf(tsdf, avoid=masked([DOWN])), lambda: planner.plan_tsdf(tsdf, keep_out=masked([[0, 0, 1, 0]])),
        lambda: planner.plan_tsdf(tsdf, target_m=masked([0.1, 0.1, 0.1])),
        lambda: planner.plan_tsdf(tsdf, reach=[masked([0, 0, 0]), [0.3, 0.3, 0.3]]), lambda: graspmill.grasp_crops(masked(tsdf), [DOWN]),
        lambda: graspmill.grasp_crops(tsdf, masked([DOWN])), lambda: graspmill.execute(scene, masked([DOWN])),
        lambda: graspmill.execute(scene, [DOWN], targets=masked([0])), lambda: graspmill.Object.cuboid(masked([0.1, 0.1, 0.1]), (0, 0, 0)),
        lambda: graspmill.Object.cuboid((0.1, 0.1, 0.1), masked([0, 0, 0])),
        lambda: graspmill.Object.mesh((masked(np.eye(3)), [[0, 1, 2]]), (0, 0, 0)),
        lambda: graspmill.Object.mesh((np.eye(3), masked([[0, 1, 2]])), (0, 0, 0)),
        lambda: graspmill.Camera.from_K(masked(np.diag([500.0, 500.0, 1.0])), (480, 640), (0, 0, 0)),
        lambda: graspmill.Camera.look_at(masked([0.1, 0.1, 0.5])),
        lambda: graspmill.Camera(640, 480, 500, 500, 320, 240, masked(np.eye(4))),
    ):  # fmt: skip
        refused(r"without a mask.*\.filled\(nan\)", call)
    assert len(planner.plan(hidden.filled(np.nan), camera)) >= 0


def test_text_that_cannot_be_written_is_refused(planner, tmp_path):
    bad = "a\ud800"
    numbers = {key: value for key, value in vars(graspmill.Gripper.load("wsg_50")).items() if key != "name"}
    tetrahedron = (np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]), [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    tsdf = scene.tsdf([camera])
    for call in (
        lambda: graspmill.Object.mesh(tetrahedron, (0, 0, 0), name=bad), lambda: graspmill.Object.solid(bad, (0.1, 0.1, 0.1), (0, 0, 0)),
        lambda: graspmill.Gripper(name=bad, **numbers), lambda: graspmill.Gripper.load(bad), lambda: graspmill.Planner(bad),
        lambda: graspmill.Planner(model=bad), lambda: graspmill.Dataset(bad), lambda: graspmill.generate(bad),
        lambda: graspmill.execute(scene, [DOWN], settings={bad: 1}),
        lambda: graspmill.execute(scene, [DOWN], settings={"physics.engine": bad}), lambda: planner.plan_tsdf(tsdf, policy=bad),
        lambda: planner.plan_tsdf(tsdf).page(bad), lambda: graspmill.Page("<p>").save(tmp_path / bad),
        lambda: graspmill.Page(bad).save(tmp_path / "page.html"),
    ):  # fmt: skip
        refused("must be", call)
    assert list(tmp_path.iterdir()) == []


def test_it_can_be_imported_where_it_was_not_installed(tmp_path):
    for package in (graspmill, np):
        folder = Path(package.__file__).parent
        shutil.copytree(folder, tmp_path / folder.name) if package is graspmill else (tmp_path / "numpy").symlink_to(folder)
    libraries = Path(np.__file__).parents[1] / "numpy.libs"
    if libraries.exists():
        (tmp_path / "numpy.libs").symlink_to(libraries)
    code = f"import sys; sys.path.insert(0, {str(tmp_path)!r}); import graspmill; print(graspmill.__file__, graspmill.__version__)"
    done = ran(sys.executable, "-I", "-S", "-c", code, cwd=tmp_path)
    assert done.stdout.split() == [str(tmp_path / "graspmill/__init__.py"), graspmill.__version__], done


def test_a_page_is_replaced_whole_or_not_at_all(tmp_path):
    file = tmp_path / "page.html"
    assert graspmill.Page("old").save(file) == file and graspmill.Page("ä old").save(str(file)) == file
    code = f"graspmill.Page('x' * 100_000).save({str(file)!r})"
    limited = ran(sys.executable, "-c", SCENE + code, code=None, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (4_096, 4_096)))
    assert "OSError" in limited.stderr and limited.returncode == 1
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"] and file.read_text(encoding="utf-8") == "ä old"
    with pytest.raises(FileNotFoundError):
        graspmill.Page("new").save(tmp_path / "nowhere" / "page.html")
    file.unlink()
    file.symlink_to("/dev/full")
    with pytest.raises(OSError, match="space"):
        graspmill.Page("new").save(file)
