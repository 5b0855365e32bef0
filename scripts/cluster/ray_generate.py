#!/usr/bin/env python3
"""Makes the missing shards of a dataset on a Ray cluster, one task per shard, and completes it. See docs/cluster.md.

    python scripts/cluster/ray_generate.py --shards 64 --out s3://bucket/grasps --attempts 200000

`--out` must be the same place for all nodes: a shared folder or a URL. Every node needs the same version of `generator`.
Unknown options (--attempts, --seed, --config, ...) are passed to the generator.

Exit codes are the generator's: 0 if the dataset is complete, 65 or 78 if a shard ended with it (the others are cancelled), 69
if shards are missing, 75 if all tries of a shard failed. Running the script again makes the missing shards.
"""

import argparse
import subprocess
import sys

import ray

TRY_AGAIN, CONFIG = 75, 78
RETRIES_MAX = 4


class TryAgain(Exception):
    """The outside world failed, or a signal ended the generator."""


def arguments():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.allow_abbrev = False  # unknown options are passed to the generator
    parser.add_argument("--out", required=True, help="folder that all nodes see, or URL")
    parser.add_argument("--shards", required=True, type=int, help="shards of the whole dataset")
    parser.add_argument("--generator", default="generator", help="the program on every node [generator]")
    parser.add_argument("--cpus", default=1, type=int, help="cores and threads per task [1]")
    parser.add_argument("--address", default="auto", help="of the Ray cluster [auto: the one of this node]")
    return parser.parse_known_args()


@ray.remote(max_retries=RETRIES_MAX, retry_exceptions=[TryAgain])
def make_shard(command, shard):
    """The shard, the generator's exit code and its last messages. Ray retries if this raises `TryAgain` or its worker dies.
    If the dead worker's generator continues, two processes write the same bytes, which is harmless."""
    try:
        ended = subprocess.run([*command, "--shard-index", str(shard)], capture_output=True, text=True)
    except FileNotFoundError as error:
        return shard, CONFIG, str(error)
    if ended.returncode < 0 or ended.returncode == TRY_AGAIN:
        raise TryAgain(f"shard {shard} ended with {ended.returncode}: {ended.stderr[-500:]}")
    return shard, ended.returncode, ended.stderr[-500:]


def missing(generator, out, shards):
    """The shards to make: those that `graspmill dataset missing` prints, or all if there is no dataset yet."""
    listed = subprocess.run([generator, "missing", out], stdout=subprocess.PIPE, text=True)
    if listed.returncode == CONFIG:
        return list(range(shards))
    listed.check_returncode()
    ranges = [part.split("-") for part in listed.stdout.strip().split(",") if part]
    return [shard for ends in ranges for shard in range(int(ends[0]), int(ends[-1]) + 1)]


def make(command, shards, cpus):
    """0 if all shards are made, else the exit code of the first that failed."""
    task = make_shard.options(num_cpus=cpus)
    waiting = [task.remote(command, shard) for shard in shards]
    while waiting:
        [done], waiting = ray.wait(waiting)
        try:
            shard, code, said = ray.get(done)
        except (TryAgain, ray.exceptions.RayError) as error:
            shard, code, said = None, TRY_AGAIN, str(error)
        if code != 0:
            print(f"shard {shard} ended with {code}: {said}" if shard is not None else said, file=sys.stderr)
            for other in waiting:
                ray.cancel(other)
            return code
        print(f"shard {shard} is made, {len(waiting)} to go", flush=True)
    return 0


def main():
    mine, more = arguments()
    ray.init(address=mine.address)
    sizes = ["--shards", str(mine.shards), "--threads", str(mine.cpus)]
    command = [mine.generator, *sizes, "--out", mine.out, *more]
    code = make(command, missing(mine.generator, mine.out, mine.shards), mine.cpus)
    return code or subprocess.run([mine.generator, "finalize", mine.out]).returncode


if __name__ == "__main__":
    sys.exit(main())
