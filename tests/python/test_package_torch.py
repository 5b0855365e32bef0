"""`graspmill.torch`: the trainer's samples and split, the order, workers, and weights to and from the trainer."""

import json
import weakref
from pathlib import Path

import numpy as np
import pytest

from grasp_sets import graspmill, keys_of, refused
from programs import commanded, packaged

torch = pytest.importorskip("torch")

import graspmill._order  # noqa: E402
import graspmill.torch as gt  # noqa: E402


def axis_of(rotation):
    """The approach of a quaternion."""
    x, y, z, w = rotation
    return [2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)]


def test_the_split_is_the_trainers(dataset, tmp_path):
    run = tmp_path / "run"
    packaged("fit", "--data", dataset._native.location, "--run", run, "--epochs", "1")
    metrics = json.loads((run / "metrics.jsonl").read_text().splitlines()[0])
    counts = {split: gt.GraspStream(dataset, split).sample_count for split in ("train", "test-attempts", "test-scenes")}
    assert counts == {name: metrics[name.replace("-", "_")]["samples"] for name in counts}
    assert sum(counts.values()) == gt.GraspStream(dataset, "all").sample_count
    labels = {split: float(torch.cat([b["label"] for b in gt.GraspStream(dataset, split)]).mean()) for split in counts}
    for split in ("test-attempts", "test-scenes"):
        matrix = metrics[split.replace("-", "_")]["confusion"]
        held = matrix["true_positive"] + matrix["false_negative"]
        assert np.isclose(labels[split], held / counts[split])


def stored(stream_type, dataset, **more):
    """Places of all samples, and a function that reads those at some of them, in order."""
    stream = stream_type(dataset, "all", batch=1, shuffle=False, **more)
    places = np.nonzero(stream._samples.wanted)[0].tolist()
    return places, lambda wanted: [{name: value[0] for name, value in one.items()} for at, one in zip(places, stream) if at in wanted]


def test_samples_are_the_rows_of_the_tables(dataset):
    places, read = stored(gt.GraspStream, dataset)
    rows = pytest.importorskip("polars").DataFrame(dataset.attempts())
    voxel_m = 0.3 / 40
    wanted = [places[index] for index in (0, 17, -1)]
    for place, item in zip(wanted, read(wanted), strict=True):
        row = rows.row(place, named=True)
        approach = np.array(axis_of(row[name] for name in ("qx", "qy", "qz", "qw")))
        at = np.floor((np.array([row["x_m"], row["y_m"], row["z_m"]]) - 0.05 * approach) / voxel_m)
        assert item["voxel"].tolist() == at.tolist() and item["label"] == row["label"]
        assert np.allclose(item["rotation"], [row["qx"], row["qy"], row["qz"], row["qw"]])
        assert np.array_equal(item["tsdf"][0], dataset.scene(row["scene_id"]).tsdf)
        assert bool(item["width"] > 0) == bool(row["label"])


@pytest.mark.parametrize("workers", [0, 2])
def test_a_stream_has_every_sample_once_in_a_seeded_order(dataset, workers):
    def epoch(number, **more):
        stream = gt.GraspStream(dataset, "train", batch=32, buffer_scenes=16, **more)
        stream.set_epoch(number)
        seen = []
        for batch in torch.utils.data.DataLoader(stream, batch_size=None, num_workers=workers):
            assert batch["tsdf"].shape[1:] == (1, 40, 40, 40) and batch["scene"].max() < len(batch["tsdf"])
            assert len(batch["label"]) <= 32
            seen.extend(keys_of(batch))
        return seen, stream.sample_count

    first, count = epoch(0)
    assert len(first) == count and epoch(0)[0] == first
    second = epoch(1)[0]
    assert second != first and sorted(second) == sorted(first)
    stored = sorted(epoch(0, shuffle=False)[0])
    assert stored == sorted(first)


@pytest.mark.parametrize("workers", [0, 2])
def test_a_loader_that_would_make_batches_of_batches_is_refused(dataset, workers):
    loader = torch.utils.data.DataLoader(gt.GraspStream(dataset, "train", batch=16), num_workers=workers)
    refused("batch_size must be None", lambda: next(iter(loader)))


def test_workers_that_live_on_have_the_order_of_each_epoch(dataset):
    def loader(stream, lives_on):
        return torch.utils.data.DataLoader(stream, batch_size=None, num_workers=2, persistent_workers=lives_on)

    def order(batches):
        return [batch["rotation"].sum().item() for batch in batches]

    stream = gt.GraspStream(dataset, "train", batch=16)
    anew, living, epochs = loader(stream, False), loader(stream, True), []
    for epoch in range(3):
        stream.set_epoch(epoch)
        epochs.append(order(anew))
        assert order(living) == epochs[-1]
    assert epochs[0] != epochs[1] != epochs[2] and len(epochs[0]) > 8
    # What follows a resumed epoch has its first steps, too.
    again = gt.GraspStream(dataset, "train", batch=16)
    again.load_state_dict(stream.state_dict(7, workers=2) | {"epoch": 0})
    living = loader(again, True)
    assert order(living) == epochs[0][7:]
    again.set_epoch(1)
    assert order(living) == epochs[1]


def test_the_last_scene_of_a_stream_may_have_fewer_attempts(tmp_path):
    dataset = graspmill.generate(tmp_path / "data", attempts=90, shards=1, seed=3)
    assert dataset.info["attempts_per_scene"] == 60
    stream = gt.GraspStream(dataset, "all", batch=16)
    assert sum(len(batch["label"]) for batch in stream) == stream.sample_count > 80


def test_a_stream_holds_no_more_grids_than_it_may(dataset, monkeypatch):
    monkeypatch.setattr(graspmill._order, "BLOCK", 2)
    stream = gt.GraspStream(dataset, "train", batch=8, samples_per_scene=8, buffer_scenes=3)
    read, blocks, alive = stream._samples.read, [], []

    def watched(*arguments):
        grids, where, rows = read(*arguments)
        blocks.append(weakref.ref(grids))
        return grids, where, rows

    together = stream._together

    def counted(held, drawn):
        # A view would keep its whole block.
        assert all(grid.base is None and len(chosen) <= 8 for grid, _, chosen in held)
        alive.append(sum(block() is not None for block in blocks))
        return together(held, drawn)

    monkeypatch.setattr(stream._samples, "read", watched)
    monkeypatch.setattr(stream, "_together", counted)
    assert len(list(stream)) > 10
    assert len(blocks) > 8 and max(alive) == 0, alive


def test_wrong_grids_of_grasps_are_refused(dataset):
    pose = dataset.scene(0).workspace_from_grasp[:1]
    for grid, match in (
        (np.full((40, 40, 40), -1.0), "between 0 and 1"),
        (np.full((40, 40, 39), 0.5), "cube of 8 to 128"),
        ([[1, 2], [3]], "tsdf must be"),
        (np.full((4, 4, 4), 0.5), "cube of 8 to 128"),
    ):
        refused(match, lambda: graspmill.grasp_crops(grid, pose))
    refused("at most 100000 grasps", lambda: graspmill.grasp_crops(np.full((40, 40, 40), 0.5), np.repeat(pose, 100_001, axis=0)))
    assert graspmill.grasp_crops(np.full((40, 40, 40), 0.5), pose[:0]).crop.shape == (0, 8, 20, 28, 4)


def test_crops_are_what_the_trainers_judge_sees(dataset, tmp_path):
    rows = pytest.importorskip("polars").DataFrame(dataset.attempts())
    places, read = stored(gt.GraspCropStream, dataset)
    wanted = [places[index] for index in (0, 5, -1)]
    for place, item in zip(wanted, read(wanted), strict=True):
        row = rows.row(place, named=True)
        scene = dataset.scene(row["scene_id"])
        pose = [row[name] for name in ("x_m", "y_m", "z_m", "qx", "qy", "qz", "qw")]
        seen = graspmill.grasp_crops(scene.tsdf, [pose], views=len(scene.cameras))
        assert np.array_equal(item["crop"].permute(1, 2, 3, 0), seen.crop[0])
        assert np.array_equal(item["context"].permute(1, 2, 3, 0), seen.context[0])
        assert np.array_equal(item["features"], seen.features[0]) and bool(item["hits_table"]) == seen.hits_table[0]
        assert graspmill.OUTCOMES[int(item["outcome"])] == row["outcome"] and int(item["label"]) == row["label"]
    config = Path(__file__).parents[2] / "configs" / "train" / "judge.toml"
    packaged("fit", "--config", config, "--data", dataset._native.location, "--run", tmp_path / "run", "--epochs", "1")
    metrics = json.loads((tmp_path / "run" / "metrics.jsonl").read_text().splitlines()[0])
    for split in ("train", "test-attempts", "test-scenes"):
        stream = gt.GraspCropStream(dataset, split, by="scene", test_share=0.05, other_share=0.02)
        assert stream.sample_count == metrics[split.replace("-", "_")]["samples"], split


@pytest.mark.parametrize("workers", [0, 2])
def test_a_stream_of_grasps_is_seeded_and_mirrored(dataset, workers):
    def epoch(shuffle):
        stream = gt.GraspCropStream(dataset, "train", batch=64, shuffle=shuffle)
        batches = list(torch.utils.data.DataLoader(stream, batch_size=None, num_workers=workers))
        assert batches[0]["crop"].shape == (64, 4, 8, 20, 28) and not any(b["hits_table"].any() for b in batches)
        return {name: torch.cat([b[name] for b in batches]) for name in batches[0]}

    first, again, stored = epoch(True), epoch(True), epoch(False)
    assert all(torch.equal(first[name], again[name]) for name in first)
    assert first["label"].sum() == stored["label"].sum() and len(first["crop"]) == len(stored["crop"])
    # Mirrored in x or y: the sign of where up is along that axis. About as many are as are not.
    for axis in (0, 1):
        by_height = lambda seen: sorted(seen["features"][:, [3, 2, axis]].tolist())  # noqa: B023
        pairs = [(a[2], b[2]) for a, b in zip(by_height(first), by_height(stored)) if abs(b[2]) > 0.05]
        assert np.allclose(*np.abs(np.array(pairs)).T, atol=1e-5)
        assert len(pairs) > 20 and 0.25 < np.mean([a * b < 0 for a, b in pairs]) < 0.75


def test_the_head_by_closing_goes_both_ways(tmp_path):
    dataset = graspmill.generate(tmp_path / "few", shards=1, attempts=120, seed=2)  # PyTorch answers at every voxel
    torch.manual_seed(3)
    net = gt.VoxelNetwork(head="closings", origin_behind_tips_m=0.035)
    with torch.no_grad():  # peaks that differ from voxel to voxel
        net.conv_turn.weight *= 40.0
        net.conv_qual.weight *= 20.0
    ours = tmp_path / "ours.safetensors"
    net.save(ours)
    back = gt.VoxelNetwork.load(ours)
    for name in ("head", "upsampling", "origin_behind_tips_m", "voxel_offset"):
        assert getattr(back, name) == getattr(net, name), name
    assert all(torch.equal(tensor, back.state_dict()[name]) for name, tensor in net.state_dict().items())

    # The grasp that it answers with: a rotation along its approach, with the best quality of all turns' peaks.
    batch = next(iter(gt.GraspStream(dataset, "all", batch=16, shuffle=False)))
    with torch.no_grad():
        dense, (quality, rotation, width) = net.heads(batch["tsdf"]), net.at(batch)
    approach = dense["approach"][batch["scene"], :, *batch["voxel"].T]
    assert torch.allclose(rotation.norm(dim=1), torch.ones(16), atol=1e-5)
    assert torch.allclose(torch.stack(axis_of(rotation.unbind(1)), dim=1), approach, atol=1e-4)
    assert quality.shape == width.shape == (16,) and ((quality > 0) & (quality < 1)).all()

    commanded("weights", "export", ours, "--format", "onnx", "--out", tmp_path / "net.onnx")
    onnxruntime = pytest.importorskip("onnxruntime")
    run = onnxruntime.InferenceSession(tmp_path / "net.onnx", providers=["CPUExecutionProvider"])
    names = [output.name for output in run.get_outputs()]
    assert names == ["quality_logit", "approach", "turns", "width", "tips"]
    volumes = dict(zip(names, run.run(names, {"tsdf": batch["tsdf"][:1].numpy()})))
    dense = {name: head[:1] for name, head in dense.items()}
    dense["turns"] = torch.softmax(dense.pop("turn_logits"), dim=1)
    for name, volume in volumes.items():
        assert np.abs(volume - dense[name].numpy()).max() < 2e-4, name


def test_samples_of_another_origin_are_at_other_voxels(dataset):
    (tips, read_tips), (roots, read_roots) = (stored(gt.GraspStream, dataset, origin_behind_tips_m=origin) for origin in (0.0, 0.05))
    places = sorted({*tips} & {*roots})[::40]
    assert len(places) > 5 and len(roots) < len(tips), "some roots are outside the grid"
    for a, b in zip(read_tips(places), read_roots(places), strict=True):
        approach = torch.tensor(axis_of(a["rotation"].tolist()))
        assert torch.allclose(a["rotation"], b["rotation"]) and a["label"] == b["label"]
        # 50 mm are 6.67 voxels; both positions are rounded.
        assert ((a["voxel"] - b["voxel"]) - approach * 0.05 / 0.0075).abs().max() <= 1.0
    refused("must be left out", lambda: gt.GraspCropStream(dataset, "train", origin_behind_tips_m=0.05))


def test_what_is_wrong_is_named(dataset):
    for match, arguments in (
        ("split must be", {"split": "validation"}),
        ("by must be", {"by": "shape"}),
        ("test_share must be between", {"test_share": 0.9}),
        ("batch must be between", {"batch": 0}),
    ):
        refused(match, lambda: gt.GraspStream(dataset, **arguments))
