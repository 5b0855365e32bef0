"""Scenes for Isaac Sim and others: USD as text, with UsdPhysics.

``scene.usda`` is a stage: metres, kilograms, z up. ``hand.usda`` is the gripper, in its grasp frame. How two frictions
combine is a matter of the engine; ``physxMaterial:frictionCombineMode`` asks PhysX for our product.
"""

from typing import Any, Iterable

import numpy as np

from .._files import joined, number
from ._world import Body, Box, Hull, Single, World

#: Focal length of every camera, in tenths of a metre, as USD counts it; only its ratio to the aperture matters.
FOCAL = Single(0.24)


def files(world: World) -> dict[str, str]:
    return {"scene.usda": _stage("World", _scene(world)), "hand.usda": _stage("hand", _gripper(world))}


def _stage(root: str, prim: list[str]) -> str:
    head = f'#usda 1.0\n(\n    defaultPrim = "{root}"\n    kilogramsPerUnit = 1\n    metersPerUnit = 1\n    upAxis = "Z"\n)\n'
    return "\n".join([head, *prim, ""])


def _prim(kind: str, name: str, schemas: Iterable[str], *inside: str | list[str]) -> list[str]:
    """The lines of a prim with its applied schemas, and with attributes and other prims in it."""
    listed = ", ".join(f'"{schema}"' for schema in schemas)
    lines = [line for one in inside for line in ([one] if isinstance(one, str) else one)]
    head = ["(", f"    prepend apiSchemas = [{listed}]", ")"] if listed else []
    return [f'def {kind} "{name}"', *head, "{", *(f"    {line}" for line in lines), "}"]


def _tuple(values: Iterable[Any]) -> str:
    return f"({joined(values, ', ')})"


def _wxyz(rotation: Any) -> str:
    return _tuple((rotation[3], *rotation[:3]))


def _ops(first: str, second: str) -> str:
    return f'uniform token[] xformOpOrder = ["xformOp:{first}", "xformOp:{second}"]'


def _placed(pose: Any) -> list[str]:
    at = f"double3 xformOp:translate = {_tuple(pose[:3])}"
    return [f"quatf xformOp:orient = {_wxyz(pose[3:])}", at, _ops("translate", "orient")]


def _shape(name: str, shape: Box | Hull, material: str) -> list[str]:
    bound, schemas = f"rel material:binding:physics = <{material}>", ["PhysicsCollisionAPI", "MaterialBindingAPI"]
    if isinstance(shape, Box):
        scale, at = f"float3 xformOp:scale = {_tuple(shape.half_m)}", f"double3 xformOp:translate = {_tuple(shape.centre_m)}"
        extent = "float3[] extent = [(-1, -1, -1), (1, 1, 1)]"
        return _prim("Cube", name, schemas, extent, bound, "double size = 2", scale, at, _ops("translate", "scale"))
    corners = shape.corners_m
    surface = [
        f"float3[] extent = [{_tuple(corners.min(axis=0))}, {_tuple(corners.max(axis=0))}]",
        f"int[] faceVertexCounts = [{joined(map(len, shape.faces), ', ')}]",
        f"int[] faceVertexIndices = [{joined(sum(shape.faces, []), ', ')}]",
        bound,
        'uniform token physics:approximation = "convexHull"',
        f"point3f[] points = [{', '.join(map(_tuple, corners))}]",
        'uniform token subdivisionScheme = "none"',
    ]
    return _prim("Mesh", name, [schemas[0], "PhysicsMeshCollisionAPI", schemas[1]], surface)


def _material(name: str, friction: np.float32) -> list[str]:
    one, other = (f"float physics:{kind}Friction = {number(friction)}" for kind in ("dynamic", "static"))
    product = 'uniform token physxMaterial:frictionCombineMode = "multiply"'
    return _prim("Material", name, ["PhysicsMaterialAPI", "PhysxMaterialAPI"], one, "float physics:restitution = 0", other, product)


def _body(body: Body, *inside: list[str]) -> list[str]:
    mass = [
        f"point3f physics:centerOfMass = {_tuple(body.mass.centre_m)}",
        f"float3 physics:diagonalInertia = {_tuple(body.mass.moments_kg_m2)}",
        f"float physics:mass = {number(body.mass.mass_kg)}",
        f"quatf physics:principalAxes = {_wxyz(body.mass.axes)}",
    ]
    return _prim("Xform", body.name, ["PhysicsRigidBodyAPI", "PhysicsMassAPI"], mass, *inside)


def _scene(world: World) -> list[str]:
    gravity = f"float physics:gravityMagnitude = {number(world.plain['gravity_m_s2'])}"
    (table, *containers), materials = world.still, "/World/materials"
    prims = [
        _prim("PhysicsScene", "physicsScene", [], "vector3f physics:gravityDirection = (0, 0, -1)", gravity),
        _prim("Scope", "materials", [], *(_material(body.name, body.friction) for body in (table, *world.objects))),
        _shape("table", table.parts["table"], f"{materials}/table"),
    ]
    for body in containers:
        walls = (_shape(f"part_{place}", part, f"{materials}/table") for place, part in enumerate(body.parts.values()))
        prims.append(_prim("Xform", body.name, [], *walls))
    for item in world.objects:
        parts = (_shape(f"part_{place}", part, f"{materials}/{item.name}") for place, part in enumerate(item.parts.values()))
        prims.append(_body(item, _placed(item.pose), *parts))
    lens = ["float2 clippingRange = (0.01, 100)", f"float focalLength = {number(FOCAL)}"]
    for axis, place in (("horizontal", 0), ("vertical", 1)):
        size, focal = Single(world.lens[place]), Single(world.lens[place + 2])
        lens.append(f"float {axis}Aperture = {number(Single(Single(FOCAL * size) / focal))}")
    for camera, pose in enumerate(world.cameras):
        prims.append(_prim("Camera", f"camera_{camera}", [], lens, _placed(pose)))
    return _prim("Xform", "World", [], *prims)


def _gripper(world: World) -> list[str]:
    prims = [_prim("Scope", "materials", [], _material("hand", world.gripper_parts[0].friction))]
    prims += [_body(body, _shape("box", body.parts[body.name], "/hand/materials/hand")) for body in world.gripper_parts]
    # A joint slides along its frames' +y; half a turn about z makes that the workspace's −y.
    for name, axes in (("left_finger", "(1, 0, 0, 0)"), ("right_finger", "(0, 0, 0, 1)")):
        joint = [
            f"float drive:linear:physics:damping = {number(world.damping)}",
            f"float drive:linear:physics:maxForce = {number(world.gripper['finger_force_n'])}",
            "float drive:linear:physics:stiffness = 0",
            "float drive:linear:physics:targetVelocity = 0",
            'uniform token drive:linear:physics:type = "force"',
            'uniform token physics:axis = "Y"',
            "rel physics:body0 = </hand/palm>",
            f"rel physics:body1 = </hand/{name}>",
        ]
        ends = [[f"point3f physics:localPos{end} = (0, 0, 0)", f"quatf physics:localRot{end} = {axes}"] for end in range(2)]
        limits = ["float physics:lowerLimit = 0", f"float physics:upperLimit = {number(world.stroke_m)}"]
        prims.append(_prim("PhysicsPrismaticJoint", f"{name}_slide", ["PhysicsDriveAPI:linear"], joint, *ends, limits))
    return _prim("Xform", "hand", ["PhysicsArticulationRootAPI"], *prims)
