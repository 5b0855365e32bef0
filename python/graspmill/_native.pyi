from os import PathLike
from typing import Any, Sequence, final

import numpy as np
from numpy.typing import NDArray

__all__ = [
    "Annotation",
    "Body",
    "Crops",
    "Dataset",
    "Experiment",
    "Generation",
    "Plan",
    "Planner",
    "Planning",
    "Scene",
    "Seen",
    "Simulation",
    "__version__",
    "check_checkpoint",
    "end",
    "execute",
    "experiment_page",
    "fuse",
    "publish",
    "run_program",
]

__version__: str

_Floats = NDArray[np.float32]
_Hull = tuple[list[list[float]], list[list[int]]]
_Path = str | PathLike[str]

@final
class Simulation:
    gripper: str
    flange_from_grasp: list[float] | None
    joint: list[float] | None
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
    off_m: float
    def __new__(
        cls, name: str, extents_m: Sequence[float], parts: Sequence[Sequence[Sequence[float]]] | None,
        mesh: tuple[Sequence[Sequence[float]], Sequence[Sequence[int]]] | None = None,
    ) -> Body: ...  # fmt: skip
    def __getnewargs__(self) -> tuple[str, list[float], list[list[list[float]]] | None, tuple[list[list[float]], list[list[int]]] | None]: ...
    @staticmethod
    def solid(kind: str, extents_m: Sequence[float]) -> Body: ...
    @staticmethod
    def mesh(
        name: str, vertices_m: _Floats, triangles: NDArray[np.uint32], parts_max: int, corners_max: int, tolerance_m: float
    ) -> Body: ...
    def parts(self) -> list[_Floats]: ...

@final
class Annotation:
    made: int
    def __new__(
        cls,
        body: tuple[Body, float, float, Sequence[float]] | None,
        file: tuple[_Path, float | None, str | None] | None,
        simulation: Simulation,
        params: tuple[int, bool, Sequence[float], str, float, bool, int, int, int],
        given: _Floats | None,
        threads: int,
    ) -> Annotation: ...
    def has_ended(self) -> bool: ...
    def info(self) -> str: ...
    def columns(self) -> dict[str, Any]: ...

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
        self, shard: int, scenes: Sequence[int], of_grasps: bool, origin_behind_tips_m: float
    ) -> tuple[_Floats, _Floats, _Floats, NDArray[np.uint32]]: ...
    def crops(self) -> Crops: ...
    def split(self, seed: int, by: str, shares: Sequence[float], of_grasps: bool, origin_behind_tips_m: float) -> NDArray[np.uint8]: ...
    def intrinsics(self) -> list[float]: ...
    def verify(self) -> list[str]: ...
    def report(self, html: bool) -> str: ...
    def hulls(self, scene_id: int) -> tuple[list[list[_Hull]], list[_Hull]]: ...
    def depth_images(self, scene_id: int) -> list[NDArray[np.float32]]: ...
    def scene_page(self, scene_id: int) -> str: ...
    def replay_page(self, scene_id: int, attempt_id: int) -> str: ...
    @staticmethod
    def names() -> tuple[list[str], list[str]]: ...

@final
class Crops:
    def __new__(cls, simulation: Simulation, resolution: int, size_m: float, table_z_m: float) -> Crops: ...
    def see(
        self, grids: _Floats, workspace_from_grasp: _Floats, rows: NDArray[np.uint32]
    ) -> tuple[list[_Floats], NDArray[np.bool_]]: ...

@final
class Planner:
    def grid(self, request: dict[str, Any] | None) -> tuple[float, int, float]: ...
    model_id: str
    gripper_name: str
    def __new__(cls, config: _Path | None, model: _Path | None, gripper: Simulation | None, threads: int) -> Planner: ...
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
    def next(self, will_do: list[bool] | None) -> list[list[float]] | Plan: ...
    def leave(self) -> None: ...

@final
class Plan:
    timings_ms: list[tuple[str, float]]
    def json(self) -> str: ...
    def page(self, title: str) -> str: ...
    def overlay(self, image: NDArray[np.uint8] | None) -> bytes: ...
    def cloud(self) -> _Floats: ...
    def labels(self) -> NDArray[np.int32]: ...

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

@final
class Seen:
    object_count: int
    finds_table: bool
    workspace_size_m: float | None
    down: list[float]
    def depths(self) -> list[_Floats]: ...
    def objects(self) -> list[NDArray[np.int32]]: ...
    def cameras(self) -> list[tuple[list[float], list[float]]]: ...
    def failed(self) -> _Floats: ...

@final
class Experiment:
    counts: tuple[int, int, int]
    in_short: str | None
    def __new__(
        cls,
        out: _Path,
        config: _Path | None,
        set: Sequence[tuple[str, str]],
        planner: tuple[str, str] | None,
        command: str,
        threads: int,
    ) -> Experiment: ...
    def gripper(self) -> Simulation: ...
    def soon(self) -> Seen | None: ...
    def answer(self, grasps: Sequence[tuple[Sequence[float], float, float | None, float | None]]) -> None: ...
    def fail(self, why: str) -> None: ...
    def stop(self) -> None: ...

def experiment_page(folder: _Path) -> str: ...
def end() -> None: ...
def check_checkpoint(path: _Path) -> None: ...
def publish(path: _Path, text: str) -> None: ...
def run_program(words: Sequence[str]) -> int: ...
