from os import PathLike
from typing import Any, Sequence, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Annotation",
    "Body",
    "Crops",
    "Dataset",
    "Generation",
    "Plan",
    "Planner",
    "Planning",
    "Scene",
    "Simulation",
    "__version__",
    "end",
    "execute",
    "fuse",
    "publish",
    "run_program",
]

__version__: str

_Floats = NDArray[np.float32]
_Path = str | PathLike[str]

@final
class Simulation:
    gripper: list[tuple[str, float]]
    gripper_name: str
    flange_from_grasp: list[float] | None
    @staticmethod
    def gripper_names() -> list[str]: ...
    def __new__(cls, config: _Path | None, set: Sequence[tuple[str, str]]) -> Simulation: ...
    def adjusted(self, set: Sequence[tuple[str, str]]) -> Simulation: ...

@final
class Body:
    name: str
    extents_m: list[float]
    volume_m3: float
    centre_m: list[float]
    def __new__(cls, name: str, extents_m: Sequence[float], parts: Sequence[Sequence[Sequence[float]]] | None) -> Body: ...
    def __getnewargs__(self) -> tuple[str, list[float], list[list[list[float]]] | None]: ...
    @staticmethod
    def solid(kind: str, extents_m: Sequence[float]) -> Body: ...
    @staticmethod
    def mesh(
        name: str, vertices_m: _Floats, triangles: NDArray[np.uint32], parts_max: int, corners_max: int, is_closed: bool
    ) -> Body: ...
    def parts(self) -> list[_Floats]: ...

@final
class Annotation:
    made: int
    def __new__(
        cls,
        body: tuple[Body, float, float] | None,
        file: tuple[_Path, float | None] | None,
        simulation: Simulation,
        params: tuple[int, bool, Sequence[float], str, bool, int, int, int],
        given: _Floats | None,
        threads: int,
    ) -> Annotation: ...
    def has_ended(self) -> bool: ...
    def info(self) -> str: ...
    def poses(self) -> _Floats: ...
    def words(self) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]: ...
    def numbers(self) -> _Floats: ...
    def free_on_table(self) -> NDArray[np.bool_]: ...
    @staticmethod
    def sources() -> list[str]: ...

@final
class Scene:
    table_z_m: float
    container: tuple[str, list[float], float] | None
    def __new__(
        cls,
        bodies: Sequence[Body],
        masses_kg: Sequence[float],
        frictions: Sequence[float],
        workspace_from_object: _Floats,
        table_z_m: float,
        container: tuple[str, Sequence[float], float] | None,
    ) -> Scene: ...
    def __len__(self) -> int: ...
    def settle(self, simulation: Simulation, drop: bool) -> Scene: ...
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
    def scene(self, scene_id: int) -> tuple[Scene, Simulation, dict[str, Any]]: ...
    def samples(
        self, shard: int, scenes: Sequence[int], of_hands: bool, origin_behind_tips_m: float
    ) -> tuple[_Floats, _Floats, _Floats, NDArray[np.uint32]]: ...
    def crops(self) -> Crops: ...
    def split(self, seed: int, by: str, shares: Sequence[float], of_hands: bool, origin_behind_tips_m: float) -> NDArray[np.uint8]: ...
    def intrinsics(self) -> list[float]: ...
    def verify(self) -> tuple[list[str], int]: ...
    def report(self, html: bool) -> str: ...
    def scene_page(self, scene_id: int) -> str: ...
    def replay_page(self, scene_id: int, attempt_id: int) -> str: ...
    @staticmethod
    def names() -> tuple[list[str], list[str]]: ...

@final
class Crops:
    def __new__(cls, hand: Simulation, resolution: int, size_m: float, table_z_m: float) -> Crops: ...
    def see(
        self, grids: _Floats, workspace_from_grasp: _Floats, rows: NDArray[np.uint32]
    ) -> tuple[list[_Floats], NDArray[np.bool_]]: ...

@final
class Planner:
    def grid(self, workspace_size_m: float | None) -> tuple[float, int, float]: ...
    model_id: str
    gripper_name: str
    def __new__(cls, config: _Path | None, model: _Path | None, hand: Simulation | None, threads: int) -> Planner: ...
    def plan_views(
        self,
        depths: Sequence[_Floats],
        intrinsics: Sequence[Sequence[float]],
        workspace_from_camera: Sequence[Sequence[float]],
        masks: Sequence[NDArray[np.bool_] | None] | None,
        request: dict[str, Any],
    ) -> Plan | Planning: ...
    def plan_cloud(
        self, points_m: _Floats, eyes_m: _Floats, object_m: _Floats, request: dict[str, Any]
    ) -> Plan | Planning: ...
    def plan_tsdf(self, values: _Floats, request: dict[str, Any]) -> Plan | Planning: ...

@final
class Planning:
    def next(self, will_do: bool | None) -> list[float] | Plan: ...
    def leave(self) -> None: ...

@final
class Plan:
    timings_ms: list[tuple[str, float]]
    def json(self) -> str: ...
    def picture(self, title: str) -> bytes: ...
    def overlay(self, image: NDArray[np.uint8] | None) -> bytes: ...
    def cloud(self) -> _Floats: ...

def execute(
    scene: Scene, workspace_from_grasp: _Floats, targets: NDArray[np.uint32] | None, simulation: Simulation, threads: int
) -> tuple[NDArray[np.uint8], _Floats, NDArray[np.int8], NDArray[np.int32], NDArray[np.uint32]]: ...
def fuse(
    depths: Sequence[_Floats],
    intrinsics: Sequence[Sequence[float]],
    workspace_from_camera: Sequence[Sequence[float]],
    resolution: int,
    size_m: float,
    truncation_voxels: float,
) -> _Floats: ...
@final
class Generation:
    counts: tuple[int, int, int]
    def __new__(
        cls,
        out: str,
        config: _Path | None,
        shards: int | None,
        attempts: int | None,
        seed: int | None,
        policy: _Path | None,
        set: Sequence[tuple[str, str]],
        rejected_max: float,
        threads: int,
    ) -> Generation: ...
    def has_ended(self) -> bool: ...
    def stop(self) -> None: ...

def end() -> None: ...
def publish(path: _Path, text: str) -> None: ...
def run_program(words: Sequence[str]) -> int: ...
