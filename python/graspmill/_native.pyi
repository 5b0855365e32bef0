from os import PathLike
from typing import Any, Sequence, final

import numpy as np
from numpy.typing import NDArray

__all__ = ["Body", "Dataset", "Laws", "Plan", "Planner", "Scene", "execute", "fuse", "generate", "run_program"]

_Floats = NDArray[np.float32]
_Path = str | PathLike[str]

@final
class Laws:
    gripper: list[tuple[str, float]]
    gripper_name: str
    def __new__(cls, config: _Path | None, set: Sequence[tuple[str, str]]) -> Laws: ...
    def adjusted(self, set: Sequence[tuple[str, str]]) -> Laws: ...

@final
class Body:
    name: str
    extents_m: list[float]
    volume_m3: float
    centre_m: list[float]
    @staticmethod
    def solid(kind: str, extents_m: Sequence[float]) -> Body: ...
    @staticmethod
    def mesh(
        name: str, vertices_m: _Floats, triangles: NDArray[np.uint32], parts_max: int, corners_max: int, is_closed: bool
    ) -> Body: ...
    def parts(self) -> list[_Floats]: ...

@final
class Scene:
    table_z_m: float
    def __new__(
        cls,
        bodies: Sequence[Body],
        masses_kg: Sequence[float],
        frictions: Sequence[float],
        workspace_from_object: _Floats,
        table_z_m: float,
    ) -> Scene: ...
    def __len__(self) -> int: ...
    def settle(self, laws: Laws, drop: bool) -> Scene: ...
    def object(self, number: int) -> tuple[Body, float, float] | None: ...
    def poses(self) -> _Floats: ...
    def render(self, intrinsics: Sequence[float], workspace_from_camera: Sequence[float]) -> _Floats: ...

@final
class Dataset:
    id: str
    location: str
    counts: tuple[int, int, int, int]
    def __new__(cls, path: str) -> Dataset: ...
    def info(self) -> str: ...
    def scenes_of(self, shard: int) -> tuple[int, int]: ...
    def stream(self, table: str, from_: int, to: int, grids: bool) -> object: ...
    def scene(self, scene_id: int) -> tuple[Scene, Laws, dict[str, Any]]: ...
    def samples(
        self, shard: int, scenes: Sequence[int]
    ) -> tuple[_Floats, NDArray[np.uint32], NDArray[np.uint32], _Floats, _Floats, NDArray[np.uint8]]: ...
    def split(self, seed: int, by: str, test_share: float, other_share: float) -> NDArray[np.uint8]: ...
    def intrinsics(self) -> list[float]: ...
    def verify(self) -> tuple[list[str], int]: ...
    def report(self, html: bool) -> str: ...
    def scene_page(self, scene_id: int) -> str: ...
    def replay_page(self, scene_id: int, attempt_id: int) -> str: ...
    @staticmethod
    def names() -> tuple[list[str], list[str]]: ...

@final
class Planner:
    grid: tuple[float, int, float]
    model_id: str
    gripper_name: str
    def __new__(cls, config: _Path | None, model: _Path | None, hand: Laws | None, threads: int) -> Planner: ...
    def plan_views(
        self,
        depths: Sequence[_Floats],
        intrinsics: Sequence[Sequence[float]],
        workspace_from_camera: Sequence[Sequence[float]],
        masks: Sequence[NDArray[np.bool_]] | None,
        asked: dict[str, Any],
    ) -> Plan: ...
    def plan_cloud(self, points_m: _Floats, eyes_m: _Floats, asked: dict[str, Any]) -> Plan: ...
    def plan_tsdf(self, values: _Floats, asked: dict[str, Any]) -> Plan: ...

@final
class Plan:
    timings_ms: list[tuple[str, float]]
    def json(self) -> str: ...
    def picture(self, title: str) -> bytes: ...
    def cloud(self) -> _Floats: ...

def execute(
    scene: Scene, workspace_from_grasp: _Floats, targets: NDArray[np.uint32] | None, laws: Laws, threads: int
) -> tuple[NDArray[np.uint8], _Floats, NDArray[np.int8], NDArray[np.int32], NDArray[np.uint32]]: ...
def fuse(
    depths: Sequence[_Floats],
    intrinsics: Sequence[Sequence[float]],
    workspace_from_camera: Sequence[Sequence[float]],
    resolution: int,
    size_m: float,
    truncation_voxels: float,
) -> _Floats: ...
def generate(
    out: str,
    config: _Path | None,
    shards: int | None,
    attempts: int | None,
    seed: int | None,
    policy: _Path | None,
    set: Sequence[tuple[str, str]],
    rejected_max: float,
    threads: int,
    progress: Any | None,
) -> tuple[int, int]: ...
def run_program(name: str, words: Sequence[str], starter: Sequence[str]) -> int: ...
