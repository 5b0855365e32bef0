"""Grasp attempts in plain Parquet.

``attempts``, ``scenes`` and ``objects`` are the dataset's tables, row by row and bit by bit, for old readers of Parquet:
floats are in the plain encoding, because fastparquet does not know BYTE_STREAM_SPLIT. ``meta/info.json`` has its
settings; there is no manifest, so that no program takes an export for the dataset.
"""

from pathlib import Path
from typing import Callable

from ...dataset import Dataset
from ...errors import DataError
from .._files import finish, module, part, write as write_file


def write(dataset: Dataset, folder: Path, done: Callable[[int], None]) -> dict[str, int]:
    """Writes the tables that are not there, shard by shard; returns counts. A batch of rows is in memory."""
    pyarrow, parquet = (module(name, "the format parquet", "datasets") for name in ("pyarrow", "pyarrow.parquet"))
    for shard in range(dataset.shard_count):
        one, (first, end) = range(shard, shard + 1), dataset._native.scenes_of(shard)
        for table in (dataset.attempts(one), dataset.scenes(one, grids=True), dataset.objects(one)):
            path = folder / table.name / f"shard-{shard:05}-of-{dataset.shard_count:05}.parquet"
            if not path.is_file():
                path.parent.mkdir(exist_ok=True)
                rows = pyarrow.RecordBatchReader.from_stream(table)
                with parquet.ParquetWriter(part(path), rows.schema, compression="zstd", use_dictionary=False) as file:
                    try:
                        for batch in rows:
                            file.write_batch(batch)
                    except pyarrow.ArrowInvalid as error:  # what a stream says of damaged data
                        raise DataError(str(error)) from error
                finish(path)
        done(end - first)
    write_file(folder / "meta/info.json", dataset._native.info())
    grasps = {"attempts": dataset.attempt_count, "grasps": dataset.attempt_count, "positives": dataset.positive_count}
    return {**grasps, "scenes": dataset.scene_count}
