//! Depth by ray casting.
//!
//! A convex part is an intersection of half-spaces, so a ray hits it where it has entered all of them and left none.
//! This takes a few multiplications per face, is exact, and uses the same faceted shapes as the physics. A ray is cast
//! only for a requested pixel, so the TSDF costs a fraction of a rendered image. Objects of meshes are drawn whole,
//! once a view.

use std::sync::Arc;

use schema::{Camera, DepthImage, Intrinsics, Plane, Polyhedron, Pose, TriangleMesh, Vec3};
use wide::f32x4;

use self::triangles::Canvas;
use crate::{Scene, SceneObject};

mod triangles;

/// A scene prepared for ray casting.
#[derive(Debug, Clone)]
pub struct SceneRays {
    table_z_m: f32,
    /// The fixtures and the parts of all objects without a mesh, in the workspace.
    parts: Vec<Polyhedron>,
    /// The meshes of the others, and their poses in the workspace.
    meshes: Vec<(Arc<TriangleMesh>, Pose)>,
}

impl SceneRays {
    /// Prepares a scene for ray casting.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let parts = scene.objects.iter().filter(|object| object.body.mesh().is_none()).flat_map(|object| {
            let pose = object.workspace_from_object;
            object.body.polyhedra().iter().map(move |part| part.moved(&pose))
        });
        let parts = scene.fixtures.iter().cloned().chain(parts).collect();
        let mesh = |object: &SceneObject| Some((Arc::clone(object.body.mesh()?), object.workspace_from_object));
        let meshes = scene.objects.iter().filter_map(mesh).collect();
        Self { table_z_m: scene.table_z_m, parts, meshes }
    }

    /// The rays of one camera.
    #[must_use]
    pub fn seen_from(&self, camera: &Camera) -> ViewRays {
        let camera_from_workspace = camera.workspace_from_camera.inverse();
        let face = |plane: Plane| plane.moved(&camera_from_workspace);
        let parts = self.parts.iter().map(|part| SeenPart {
            window: Window::around(part.corners_m(), &camera_from_workspace, &camera.intrinsics),
            faces: part.planes().map(face).collect(),
        });
        let table = face(Plane { normal: Vec3::Z, offset_m: self.table_z_m });
        let meshes = (!self.meshes.is_empty()).then(|| {
            let mut canvas = Canvas::new(&camera.intrinsics);
            self.meshes.iter().for_each(|(mesh, pose)| canvas.draw(mesh, &(camera_from_workspace * *pose)));
            canvas
        });
        ViewRays { intrinsics: camera.intrinsics, table, parts: parts.collect(), meshes }
    }

    /// The whole depth image.
    #[must_use]
    pub fn render(&self, camera: &Camera) -> DepthImage {
        let (width_px, height_px) = (camera.intrinsics.width_px, camera.intrinsics.height_px);
        let view = self.seen_from(camera);
        let mut depth_m = vec![0.0; width_px * height_px];
        for (v, row) in depth_m.chunks_mut(width_px).enumerate() {
            let pixels: Vec<[usize; 2]> = (0..width_px).map(|u| [u, v]).collect();
            view.depths_at(&pixels, row);
        }
        for depth_m in depth_m.iter_mut().filter(|depth_m| depth_m.is_infinite()) {
            *depth_m = 0.0;
        }
        DepthImage { width_px, height_px, depth_m }
    }
}

/// The rays of one camera. All data are in the camera frame, so a pixel's ray has z = 1 and its hit parameter is the
/// depth.
#[derive(Debug, Clone)]
pub struct ViewRays {
    intrinsics: Intrinsics,
    table: Plane,
    parts: Vec<SeenPart>,
    meshes: Option<Canvas>,
}

#[derive(Debug, Clone)]
struct SeenPart {
    window: Window,
    faces: Vec<Plane>,
}

/// The pixels that a part may cover: first and last column, first and last row.
#[derive(Debug, Clone, Copy)]
struct Window {
    u_px: [f32; 2],
    v_px: [f32; 2],
}

impl Window {
    fn around(corners_m: &[Vec3], camera_from_workspace: &Pose, lens: &Intrinsics) -> Self {
        let everything = Self { u_px: [f32::NEG_INFINITY, f32::INFINITY], v_px: [f32::NEG_INFINITY, f32::INFINITY] };
        let nothing = Self { u_px: [f32::INFINITY, f32::NEG_INFINITY], v_px: [f32::INFINITY, f32::NEG_INFINITY] };
        let mut window = nothing;
        for corner in corners_m {
            let seen = camera_from_workspace.transform_point(*corner);
            if seen.z <= 1e-3 {
                return everything;
            }
            // One pixel more on every side than rounding could require.
            let u = seen.x * lens.fx_px / seen.z + lens.cx_px;
            let v = seen.y * lens.fy_px / seen.z + lens.cy_px;
            window.u_px = [window.u_px[0].min(u - 1.0), window.u_px[1].max(u + 1.0)];
            window.v_px = [window.v_px[0].min(v - 1.0), window.v_px[1].max(v + 1.0)];
        }
        window
    }

    fn holds(&self, u: f32x4, v: f32x4) -> f32x4 {
        let within = |x: f32x4, [low, high]: [f32; 2]| x.simd_ge(f32x4::splat(low)) & x.simd_le(f32x4::splat(high));
        within(u, self.u_px) & within(v, self.v_px)
    }
}

impl ViewRays {
    /// Depth along the camera's z at a pixel, in metres; `None` if the ray hits nothing.
    #[must_use]
    pub fn depth_at(&self, pixel: [usize; 2]) -> Option<f32> {
        let mut depth_m = [0.0];
        self.depths_at(&[pixel], &mut depth_m);
        depth_m[0].is_finite().then_some(depth_m[0])
    }

    /// The same of many pixels, four rays at a time; infinite where a ray hits nothing. Neighbours should stand side by
    /// side, because a part is asked for all four if one of them may see it.
    pub fn depths_at(&self, pixels: &[[usize; 2]], depths_m: &mut [f32]) {
        let Intrinsics { fx_px, fy_px, cx_px, cy_px, .. } = self.intrinsics;
        for (pixels, depths_m) in pixels.chunks(4).zip(depths_m.chunks_mut(4)) {
            let at = |lane: usize| pixels.get(lane).copied().unwrap_or(pixels[0]).map(|x| x as u32 as f32);
            let [[u0, v0], [u1, v1], [u2, v2], [u3, v3]] = [at(0), at(1), at(2), at(3)];
            let (u, v) = (f32x4::new([u0, u1, u2, u3]), f32x4::new([v0, v1, v2, v3]));
            // The arithmetic of [`Intrinsics::ray`].
            let ray =
                [(u - f32x4::splat(cx_px)) / f32x4::splat(fx_px), (v - f32x4::splat(cy_px)) / f32x4::splat(fy_px)];
            let table_speed = speed(&self.table, ray);
            let mut nearest = f32x4::splat(f32::INFINITY);
            // A camera under the table does not see it.
            if self.table.offset_m < 0.0 {
                let met = f32x4::splat(self.table.offset_m) / table_speed;
                nearest = table_speed.simd_lt(f32x4::ZERO).bitselect(met, nearest);
            }
            for part in &self.parts {
                let may_see = part.window.holds(u, v);
                if may_see.any() {
                    nearest = may_see.bitselect(enter(&part.faces, ray, nearest), nearest);
                }
            }
            if let Some(meshes) = &self.meshes {
                let met = [0, 1, 2, 3].map(|lane| meshes.depth_m(pixels.get(lane).copied().unwrap_or(pixels[0])));
                nearest = nearest.fast_min(f32x4::new(met));
            }
            depths_m.copy_from_slice(&nearest.to_array()[..depths_m.len()]);
        }
    }
}

/// How fast rays through (x, y, 1) leave a plane's half-space.
#[inline(always)]
fn speed(plane: &Plane, [x, y]: [f32x4; 2]) -> f32x4 {
    let Vec3 { x: nx, y: ny, z: nz } = plane.normal;
    f32x4::splat(nx) * x + f32x4::splat(ny) * y + f32x4::splat(nz)
}

/// Depths at which rays from the origin enter the part bounded by `faces`, if less than `nearest`; else `nearest`.
#[inline(always)]
fn enter(faces: &[Plane], ray: [f32x4; 2], nearest: f32x4) -> f32x4 {
    let (mut entry, mut exit) = (f32x4::ZERO, nearest);
    for face in faces {
        let speed = speed(face, ray);
        let met = f32x4::splat(face.offset_m) / speed;
        entry = speed.simd_lt(f32x4::ZERO).bitselect(entry.fast_max(met), entry);
        exit = speed.simd_gt(f32x4::ZERO).bitselect(exit.fast_min(met), exit);
        if face.offset_m < 0.0 {
            // Beside the face and outside.
            exit = speed.simd_eq(f32x4::ZERO).bitselect(f32x4::splat(f32::NEG_INFINITY), exit);
        }
        if entry.simd_gt(exit).all() {
            return nearest;
        }
    }
    (entry.simd_le(exit) & entry.simd_gt(f32x4::ZERO)).bitselect(entry, nearest)
}

#[cfg(test)]
mod tests {
    use parry3d::query::{Ray, RayCast};
    use parry3d::shape::{ConvexPolyhedron, TriMesh};
    use schema::{Intrinsics, Pose, Purpose, ShapeKind, Solid, Stream};

    use super::*;
    use crate::faceted::shape_of;

    fn scene_of_all_shapes() -> Scene {
        let mut stream = Stream::new(11, 0, Purpose::Drops, 0);
        let objects = ShapeKind::ALL
            .into_iter()
            .enumerate()
            .map(|(i, kind)| {
                let extents = match kind {
                    ShapeKind::Cylinder => Vec3::new(0.05, 0.05, 0.07),
                    ShapeKind::HalfCylinder => Vec3::new(0.06, 0.06, 0.03),
                    _ => Vec3::new(0.03, 0.05, 0.07),
                };
                let at = Vec3::new(0.08 + 0.13 * (i % 2) as f32, 0.08 + 0.13 * (i / 2) as f32, 0.12);
                SceneObject {
                    body: Solid::new(kind, extents).unwrap().into(),
                    mass_kg: 0.1,
                    friction: 1.0,
                    workspace_from_object: Pose::from_parts(at, stream.rotation()),
                }
            })
            .collect();
        Scene { table_z_m: 0.05, fixtures: Vec::new(), objects }
    }

    fn triangles_of(solid: &Solid) -> TriMesh {
        let shape = shape_of(solid, 1.0);
        let (vertices, indices) = match shape.as_cuboid() {
            Some(cuboid) => cuboid.to_trimesh(),
            None => ConvexPolyhedron::from_convex_hull(&solid.vertices_m()).unwrap().to_trimesh(),
        };
        TriMesh::new(vertices, indices).unwrap()
    }

    /// Depths agree with parry's rays against the triangles of the physics' shapes. (Against the convex hulls
    /// themselves parry casts by GJK, which stops up to some millimetres off a faceted cylinder.)
    #[test]
    fn rays_meet_what_the_physics_feels() {
        let scene = scene_of_all_shapes();
        let rays = SceneRays::new(&scene);
        let meshes: Vec<TriMesh> = scene.objects.iter().map(|o| triangles_of(&o.body.as_solid().unwrap())).collect();
        let mut stream = Stream::new(12, 0, Purpose::Views, 0);
        let (mut on_objects, mut disagreements) = (0, 0);
        for _ in 0..100 {
            let origin = Vec3::new(stream.uniform(-0.2, 0.5), stream.uniform(-0.2, 0.5), stream.uniform(0.3, 0.7));
            let camera = looking_at(origin, stream.point(Vec3::new(0.1, 0.1, 0.05), Vec3::new(0.2, 0.2, 0.16)));
            let view = rays.seen_from(&camera);
            for _ in 0..200 {
                let pixel = [stream.uniform(0.0, 64.0) as usize, stream.uniform(0.0, 48.0) as usize];
                let direction = camera.workspace_from_camera.rotation * camera.intrinsics.ray(pixel);
                let ray = Ray::new(origin, direction);
                let table = (0.05 - origin.z) / direction.z;
                let table = if table > 0.0 { table } else { f32::INFINITY };
                let expected = meshes
                    .iter()
                    .zip(&scene.objects)
                    .filter_map(|(mesh, o)| mesh.cast_ray(&o.workspace_from_object, &ray, 100.0, true))
                    .fold(table, f32::min);
                let got = view.depth_at(pixel).unwrap_or(f32::INFINITY);
                on_objects += u32::from(expected < table * 0.98);
                // A ray along a silhouette may hit in one and miss in the other.
                let agrees = got == expected || (got - expected).abs() * direction.length() < 2e-5;
                disagreements += u32::from(!agrees);
            }
        }
        assert!(on_objects > 3_000, "only {on_objects} rays met an object");
        assert!(disagreements <= 10, "{disagreements} of 20000 rays disagree");
    }

    fn looking_at(origin: Vec3, aim: Vec3) -> Camera {
        let rotation = schema::Quat::from_rotation_arc(Vec3::Z, (aim - origin).normalize());
        let intrinsics =
            Intrinsics { width_px: 64, height_px: 48, fx_px: 160.0, fy_px: 160.0, cx_px: 32.0, cy_px: 24.0 };
        Camera { intrinsics, workspace_from_camera: Pose::from_parts(origin, rotation) }
    }

    #[test]
    fn an_image_is_its_pixels() {
        let scene = scene_of_all_shapes();
        let rays = SceneRays::new(&scene);
        let down = schema::axis_angle(Vec3::X, core::f32::consts::PI);
        let camera = Camera {
            intrinsics: Intrinsics { width_px: 64, height_px: 48, fx_px: 54.0, fy_px: 54.0, cx_px: 32.0, cy_px: 24.0 },
            workspace_from_camera: Pose::from_parts(Vec3::new(0.15, 0.15, 0.6), down),
        };
        let image = rays.render(&camera);
        assert_eq!(image.at([10, 7]), rays.seen_from(&camera).depth_at([10, 7]));
        assert!((image.at([0, 0]).unwrap() - 0.55).abs() < 1e-5, "the table lies 0.55 m below");
        assert!(image.depth_m.iter().any(|d| *d < 0.5), "some object rises above the table");
    }

    #[test]
    fn a_camera_that_looks_up_sees_nothing() {
        let rays = SceneRays::new(&scene_of_all_shapes());
        let camera = looking_at(Vec3::new(0.15, 0.15, 0.5), Vec3::new(0.16, 0.15, 1.5));
        assert_eq!(rays.seen_from(&camera).depth_at([32, 24]), None);
    }
}
