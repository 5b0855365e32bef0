"""Clouds and intrinsics of other programs, as `graspmill plan` of the package takes them."""

import io
import json
import random
import re

import numpy as np
import pytest

from grasp_sets import ALIASES, BOXED, CAMERA, graspmill, points_of, refused
from graspmill.formats.captures import cloud, lens  # noqa: E402
from programs import planned  # noqa: E402

POINTS = np.array([[1, 2, 3], [-1, 0.5, 0.25], [np.nan, 8, 9]])
PCD = "# .PCD v0.7\nVERSION 0.7\nFIELDS rgb y x _ z\nSIZE 4 4 4 1 8\nTYPE U F F U F\nCOUNT 1 1 1 3 1\nWIDTH 3\nHEIGHT 1\n{}POINTS 3\nDATA {}\n"
PLY = "ply\nformat {} 1.0\ncomment hello\nelement vertex 3\nproperty uchar red\nproperty double z\nproperty float32 x\nproperty float y\n"
PLY += "element face 1\nproperty list uchar int vertex_indices\nend_header\n"


def pcd(form, viewpoint=""):
    head = PCD.format(viewpoint, form).encode()
    if form == "ascii":
        return head + b"1 2 1 0 0 0 3\r\n1 0.5 -1 0 0 0 .25\n1 8 nan 0 0 0 9e0"
    x, y, z = (POINTS[:, axis].astype(kind) for axis, kind in enumerate(("<f4", "<f4", "<f8")))
    return head + b"".join(b"rgb0" + y[n].tobytes() + x[n].tobytes() + b"___" + z[n].tobytes() for n in range(3))


def ply(form):
    head = PLY.format(form).encode()
    if form == "ascii":
        return head + b"255 3.0 1 2e0\r\n0 .25 -1. 0.5\n1 9 nan 8\n3 0 1 2\n"
    sign = "<>"[form == "binary_big_endian"]
    rows = np.zeros(3, [("red", "u1"), ("z", f"{sign}f8"), ("x", f"{sign}f4"), ("y", f"{sign}f4")])
    rows["x"], rows["y"], rows["z"] = POINTS.T
    return head + rows.tobytes() + b"\x03" + bytes(12)


FILES = {f"a-{form}.pcd": pcd(form) for form in ("ascii", "binary")}
FILES |= {f"a-{form}.ply": ply(form) for form in ("ascii", "binary_little_endian", "binary_big_endian")}


def read(path, data):
    path.write_bytes(data)
    found = cloud(str(path))
    return None if found is None else (np.load(io.BytesIO(found[0])), found[1])


@pytest.mark.parametrize("name", FILES)
def test_a_cloud_has_its_points_and_a_damaged_one_is_named(tmp_path, name):
    path, chance = tmp_path / name, random.Random(name)
    points, eye_m = read(path, FILES[name])
    assert np.array_equal(points, POINTS, equal_nan=True) and eye_m == []
    for number in range(300):
        damaged = bytearray(FILES[name][: chance.randrange(8, len(FILES[name])) if number % 3 else None])
        for _ in range(chance.randrange(4)):
            damaged[chance.randrange(7, len(damaged))] = chance.choice([0, 9, 10, 32, 48, 57, 127, 255])
        try:
            read(path, bytes(damaged))
        except graspmill.DataError as error:
            assert re.match("not a whole (PLY|PCD) file: .*" + re.escape(str(path)), str(error), re.S)
    if "ascii" not in name:
        with pytest.raises(graspmill.DataError, match="buffer is smaller"):
            read(path, FILES[name][:-15])


def test_a_viewpoint_is_told_and_other_files_are_left(tmp_path):
    path = tmp_path / "cloud"
    assert read(path, pcd("ascii", "VIEWPOINT 0.1 0.2 0.7 0 1 0 0\n"))[1] == [0.1, 0.2, 0.7]
    assert read(path, pcd("ascii", "VIEWPOINT 0 0 0 1 0 0 0\n"))[1] == []
    assert read(path, b"\x93NUMPY") is None and read(path, b"") is None
    with pytest.raises(graspmill.DataError, match="neither a PLY nor a PCD file"):
        read(tmp_path / "junk.ply", b"junk")


@pytest.mark.parametrize(("old", "new", "expected"), [
    ("property float y", "property int y", "must have x, y and z, floats"),
    ("property float y", "property list uchar float y", "list"),
    ("element vertex 3", "element face 3", "first element must be `vertex`, got `face`"),
    ("element vertex 3", "element vertex many", "invalid literal"),
    ("element vertex 3", "element vertex 4999999", "cannot reshape array"),
    ("format ascii", "format secret", "'secret' is missing or unknown"),
])  # fmt: skip
def test_a_head_that_lies_is_refused(tmp_path, old, new, expected):
    with pytest.raises(graspmill.DataError, match=expected):
        read(tmp_path / "a.ply", ply("ascii").replace(old.encode(), new.encode(), 1))


K = "607.5, 0.0, 320.25, 0.0, 608.0, 241.0, 0.0, 0.0, 1.0"
LIST = "".join(f"- {number}\n" for number in K.split(", "))
ROS_1 = f'header:\n  seq: 808\n  frame_id: "optical"\nheight: 480\nwidth: 640\nD: [0.0, 0.0]\nK: [{K}]\nroi:\n  height: 0\n---\nheight: 1\nK: []\n---\n'
ROS_2 = f"header:\n  stamp:\n    sec: 16\nheight: 480\nwidth: 640\nd:\n- 0.0\n- 0.0\nk:\n{LIST}roi:\n  width: 0\n---\n"
OPENCV = "%YAML:1.0\n---\nimage_width: 640\nimage_height: 480 # rows\n"
OPENCV += f"camera_matrix: !!opencv-matrix\n   rows: 3\n   cols: 3\n   dt: d\n   data: [ {K} ]\n"
REALSENSE = ' Intrinsic of "Depth" / 640x480 / {Z16}\n  Width:      \t640\n  Height:     \t480\n  PPX:        \t320.25\n  PPY:        \t241\n'
REALSENSE += "  Fx:         \t607.5\n  Fy:         \t608\n  Distortion: \tBrown Conrady\n  Coeffs:     \t0  \t0  \t0\n  FOV (deg):  \t55.48 x 43.06\n\n"
PROFILE = '{"width": 640, "height": 480, "ppx": 320.25, "ppy": 241, "fx": 607.5, "fy": 608}'
OPEN3D = '{"height": 480, "intrinsic_matrix": [607.5, 0, 0, 0, 608, 0, 320.25, 241, 1], "width": 640}'
NESTED = f'{{"color": {{"fx": 1}}, "depth": {PROFILE}, "depth_scale": 0.001}}'
JSON = f'{{"height": 480, "width": 640, "d": [0.0], "roi": {{"height": 0}}, "k": [{K}]}}'
OURS = {"fx_px": 607.5, "fy_px": 608.0, "cx_px": 320.25, "cy_px": 241.0, "width_px": 640, "height_px": 480}


def lens_of(tmp_path, text):
    path = tmp_path / "lens"
    path.write_text(text)
    found = lens(str(path))
    return found and json.loads(found[0])


@pytest.mark.parametrize("text", [ROS_1, ROS_2, OPENCV, REALSENSE, PROFILE, OPEN3D, NESTED, JSON], ids=range(8))
def test_each_programs_intrinsics_are_ours(tmp_path, text):
    pytest.importorskip("yaml")
    for other in (text, text.replace("\n", "\r\n")):
        keys = lens_of(tmp_path, other)
        assert not any(keys.pop("distortion_coefficients")) and keys == OURS


def test_distortion_is_kept(tmp_path):
    text = REALSENSE.replace("\t0  \t0  \t0", "\t0  \t-0.0224  \t0")
    assert lens_of(tmp_path, text)["distortion_coefficients"] == [0, -0.0224, 0]


@pytest.mark.parametrize("text", ["", json.dumps(OURS), "fx_px = 607.5\n", "607.5 0 320\n0 608 241\n0 0 1", "[1, 2]", "a: [*a, *b]", "P6 640"])
def test_what_the_native_half_reads_or_refuses_is_left(tmp_path, text):
    assert lens_of(tmp_path, text) is None


@pytest.mark.parametrize(("text", "expected"), [
    ('{ "fx": 525, "fy": 525, "ppx": 319.5 }', r"got \[8\]: .*lens"),
    ('{ "color": { "fx": 1 }, "focal": 2 }', "got the keys color, focal: .*lens"),
    ('{ "fx": 525,', "not intrinsics: .*lens"),
    ("k: [525, 0, 319.5]", r"K must have the shape \[3, 3\]"),
    ("k: [525, 0, 319.5, 0, 525, nan, 0, 0, 1]", "finite"),
    ("k: [525, 1, 319.5, 0, 525, 239.5, 0, 0, 1]", "K must be"),
    (ROS_1.replace("D: [0.0", "D: [nan"), "not JSON compliant"),
    ("k: [525, 0", "not intrinsics: .*lens"),
    ("k: " + "[" * 5000, "not intrinsics: .*lens"),
    (REALSENSE * 2, "one RealSense profile, got 2"),
    (f"{ALIASES}K: *-8\n", "without aliases.*lens"),
])  # fmt: skip
def test_what_is_no_lens_is_refused(tmp_path, text, expected):
    pytest.importorskip("yaml")
    refused(expected, lambda: lens_of(tmp_path, text))


def test_the_command_takes_them_as_what_they_are_in_ours(tmp_path):
    depth, pose = BOXED.render(CAMERA), CAMERA.workspace_from_camera
    points = (points_of(depth) @ pose[:3, :3].T + pose[:3, 3]).astype("<f4")
    eye = " ".join(map(str, pose[:3, 3]))
    head = f"VERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nWIDTH {len(points)}\nHEIGHT 1\nVIEWPOINT {eye} 1 0 0 0\nPOINTS {len(points)}\nDATA binary\n"
    (tmp_path / "seen.pcd").write_bytes(head.encode() + points.tobytes())
    np.save(tmp_path / "seen.npy", points)
    np.save(tmp_path / "depth.npy", depth)
    (tmp_path / "ours.json").write_text(json.dumps({"fx_px": 540, "fy_px": 540, "cx_px": 320, "cy_px": 240}))
    (tmp_path / "theirs.json").write_text('{"fx": 540, "fy": 540, "ppx": 320, "ppy": 240, "coeffs": [0, 0.1]}')

    assert planned("--cloud=seen.pcd", cwd=tmp_path) == planned("--cloud", "seen.npy", f"--eye={eye.replace(' ', ',')}", cwd=tmp_path)
    theirs, ours = (planned("--depth", "depth.npy", "--intrinsics", f"{name}.json", cwd=tmp_path) for name in ("theirs", "ours"))
    assert "the lens has distortion" in theirs["warnings"].pop() and theirs == ours
    (tmp_path / "cut.pcd").write_bytes(head.encode())
    refused = planned("--cloud", "cut.pcd", code=65, cwd=tmp_path)
    assert "not a whole PCD file" in refused and "cut.pcd" in refused
