"""`graspmill.torch` on several ranks: who takes which samples, and going on within an epoch."""

import numpy as np
import pytest

from grasp_sets import graspmill, keys_of, refused
torch = pytest.importorskip("torch")

import graspmill._order  # noqa: E402
import graspmill.torch as gt  # noqa: E402

SMALL = {"batch": 12, "buffer_scenes": 6, "samples_per_scene": 8}


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    monkeypatch.setattr(graspmill._order, "BLOCK", 4)


def stream_of(dataset, rank, ranks, epoch=1, **more):
    stream = gt.GraspStream(dataset, "train", rank=rank, world_size=ranks, **{**SMALL, **more})
    stream.set_epoch(epoch)
    return stream


def batches_of(stream, workers=0):
    return list(torch.utils.data.DataLoader(stream, batch_size=None, num_workers=workers))


CASES = [(1, 0, False), (2, 2, False), (3, 0, False), (5, 2, False), (3, 2, True)]


@pytest.mark.parametrize(("ranks", "workers", "is_global"), CASES)
def test_an_epoch_of_all_ranks_has_every_sample_once_in_as_many_steps(dataset, ranks, workers, is_global):
    more = {"global_batch": is_global, "batch": 12 * ranks if is_global else 12}
    made = [batches_of(stream_of(dataset, rank, ranks, **more), workers) for rank in range(ranks)]
    whole = sorted(key for batch in gt.GraspStream(dataset, "train") for key in keys_of(batch))
    assert sorted(key for batches in made for batch in batches for key in keys_of(batch)) == whole
    steps = stream_of(dataset, 0, ranks, **more).steps(workers)
    assert {len(batches) for batches in made} == {steps}
    sizes = np.array([[len(batch["label"]) for batch in batches] for batches in made])
    shares = np.array([[batch["share"].item() for batch in batches] for batches in made])
    # Blocks are 4 scenes of about 50 samples, so workers have unequal work; yet no batch is much smaller than another.
    assert sizes.max() <= 12 and sizes.min() >= 8 and len(whole) / sizes.size > 9
    assert np.allclose(shares, sizes * ranks / sizes.sum(axis=0))


def test_one_rank_alone_has_the_order_of_a_stream_without_ranks(dataset):
    alone, without = (batches_of(stream_of(dataset, *place, batch=1, samples_per_scene=1)) for place in ((0, 1), (None, None)))
    assert list(map(keys_of, alone)) == list(map(keys_of, without))
    assert "share" in alone[0] and "share" not in without[0]


def test_each_rank_reads_its_own_shards_and_every_scene_once(dataset, monkeypatch):
    seen = {}
    for rank in range(2):
        stream = stream_of(dataset, rank, 2)
        read = stream._samples.read

        def watched(shard, scenes, rank=rank, read=read):
            seen.setdefault((rank, shard), []).extend(scenes)
            return read(shard, scenes)

        monkeypatch.setattr(stream._samples, "read", watched)
        batches_of(stream)
    assert sorted(seen) == [(0, 0), (0, 1), (1, 1), (1, 2)]
    assert sorted(scene for scenes in seen.values() for scene in scenes) == np.flatnonzero(stream._order.counts).tolist()


def test_a_global_batch_is_the_same_for_every_number_of_ranks_and_workers(dataset):
    def steps(cls, name, ranks, workers):
        common = {"batch": 30, "buffer_scenes": 6, "global_batch": True, "world_size": ranks}
        made = [batches_of(cls(dataset, "train", rank=rank, **common), workers) for rank in range(ranks)]
        return [torch.cat([batch[name] for batch in step]) for step in zip(*made)]

    for cls, name in ((gt.GraspStream, "rotation"), (gt.GraspCropStream, "features")):  # which are mirrored at random
        alone = steps(cls, name, 1, 0)
        for ranks, workers in ((2, 0), (3, 2)):
            several = steps(cls, name, ranks, workers)
            assert len(several) == len(alone) > 10
            assert all(map(torch.equal, alone, several))


@pytest.mark.parametrize(("ranks", "workers", "is_global"), [(1, 0, False), (2, 2, False), (2, 2, True)])
def test_a_stream_goes_on_where_it_was(dataset, ranks, workers, is_global, factor):
    for rank in range(ranks):
        stream = stream_of(dataset, rank, ranks, global_batch=is_global, batch=24)
        all_keys = [keys_of(batch) for batch in batches_of(stream, workers)]
        for step in (1, 5, len(all_keys) - 1, len(all_keys)) if factor > 1 or not workers else (5, len(all_keys)):
            resumed = stream_of(dataset, rank, ranks, epoch=0, global_batch=is_global, batch=24)
            resumed.load_state_dict(stream.state_dict(step, workers))
            assert (resumed.epoch, resumed.step) == (1, step)
            assert [keys_of(batch) for batch in batches_of(resumed, workers)] == all_keys[step:], step
    resumed.set_epoch(1)
    assert [keys_of(batch) for batch in batches_of(resumed, workers)] == all_keys


def test_going_on_reads_only_what_is_left(dataset, monkeypatch):
    stream = stream_of(dataset, 0, 1)
    stream.set_epoch(1, step=stream.steps() - 2)
    read, scenes = stream._samples.read, []
    monkeypatch.setattr(stream._samples, "read", lambda shard, some: scenes.extend(some) or read(shard, some))
    assert len(batches_of(stream)) == 2 and len(scenes) <= 2 * SMALL["batch"]


def test_ranks_may_come_and_go_with_a_global_batch(dataset):
    two = [[keys_of(batch) for batch in batches_of(stream_of(dataset, rank, 2, global_batch=True))] for rank in range(2)]
    state = stream_of(dataset, 0, 2, global_batch=True).state_dict(4)
    three = [stream_of(dataset, rank, 3, global_batch=True) for rank in range(3)]
    for stream in three:
        stream.load_state_dict(state)
    later = [sum((keys_of(part) for part in parts), []) for parts in zip(*map(batches_of, three))]
    assert later == [first + second for first, second in zip(*two)][4:]


def test_what_is_wrong_with_ranks_is_named(dataset):
    for match, more in (
        ("rank and world_size must be given together", {"rank": 1}),
        ("world_size must be between 1 and 65536, got 0", {"rank": 0, "world_size": 0}),
        ("rank must be between 0 and 1, got 2", {"rank": 2, "world_size": 2}),
    ):
        refused(match, lambda: gt.GraspStream(dataset, **more))
    one = {"batch": 1, "samples_per_scene": 1}
    refused("a batch must have at least 2 samples, got 1: use a larger batch or fewer ranks", lambda: stream_of(dataset, 0, 2, **one, global_batch=True).steps())
    refused("every rank must have a sample at each of the .* steps: a rank must have", lambda: stream_of(dataset, 0, 2, **one).steps())
    with pytest.raises(graspmill.InputError, match="step must be between 0 and"):
        stream = stream_of(dataset, 0, 2)
        stream.set_epoch(0, step=10_000)
        next(iter(stream))


def test_a_state_of_another_order_is_refused(dataset):
    stream = stream_of(dataset, 0, 2)
    state = stream.state_dict(3, workers=2)
    for match, other in (
        ("ranks must be 3, got 2", stream_of(dataset, 0, 3)),
        ("batch must be 13, got 12", stream_of(dataset, 0, 2, batch=13)),
        ("samples must be", stream_of(dataset, 0, 2, by="scene")),
        ("shuffle must be False, got True", stream_of(dataset, 0, 2, shuffle=False)),
    ):
        refused(f"state must be of the same order: {match}", lambda: other.load_state_dict(state))
    refused("state must be that of state_dict", lambda: stream.load_state_dict({"epoch": 1, "step": 2}))
    stream_of(dataset, 0, 3).load_state_dict(stream.state_dict(0))  # between epochs any number of ranks is right
    stream.load_state_dict(state)
    refused("num_workers must be 2, that of the state", lambda: batches_of(stream, 1))
