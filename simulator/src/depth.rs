//! Depth by ray casting.
//!
//! A convex part is an intersection of half-spaces, so a ray hits it where it has entered all of them and left none.
//! This takes a few multiplications per face, is exact, and uses the same faceted shapes as the physics. A ray is cast
//! only for a requested pixel, so the TSDF costs a fraction of a rendered image.

use schema::{Camera, DepthImage, Intrinsics, Plane, Polyhedron, Pose, Vec3};

use crate::Scene;

/// A scene prepared for ray casting.
#[derive(Debug, Clone)]
pub struct SceneRays {
    table_z_m: f32,
    /// The parts of all objects, in the workspace.
    parts: Vec<Polyhedron>,
}

impl SceneRays {
    /// Prepares a scene for ray casting.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let parts = scene.objects.iter().flat_map(|object| {
            let pose = object.workspace_from_object;
            object.body.polyhedra().into_iter().map(move |part| part.moved(&pose))
        });
        Self { table_z_m: scene.table_z_m, parts: parts.collect() }
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
        ViewRays { intrinsics: camera.intrinsics, table, parts: parts.collect() }
    }

    /// The whole depth image.
    #[must_use]
    pub fn render(&self, camera: &Camera) -> DepthImage {
        let (width_px, height_px) = (camera.intrinsics.width_px, camera.intrinsics.height_px);
        let view = self.seen_from(camera);
        let depth_m =
            (0..width_px * height_px).map(|i| view.depth_at([i % width_px, i / width_px]).unwrap_or(0.0)).collect();
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

    fn holds(&self, u: f32, v: f32) -> bool {
        self.u_px[0] <= u && u <= self.u_px[1] && self.v_px[0] <= v && v <= self.v_px[1]
    }
}

impl ViewRays {
    /// Depth along the camera's z at a pixel, in metres; `None` if the ray hits nothing.
    #[must_use]
    pub fn depth_at(&self, pixel: [usize; 2]) -> Option<f32> {
        let ray = self.intrinsics.ray(pixel);
        let [u, v] = pixel.map(|x| x as u32 as f32);
        let table_speed = self.table.normal.dot(ray);
        let mut nearest = f32::INFINITY;
        // A camera under the table does not see it.
        if table_speed < 0.0 && self.table.offset_m < 0.0 {
            nearest = self.table.offset_m / table_speed;
        }
        for part in &self.parts {
            if part.window.holds(u, v) {
                nearest = enter(&part.faces, ray, nearest);
            }
        }
        nearest.is_finite().then_some(nearest)
    }
}

/// Depth at which the ray from the origin enters the part bounded by `faces`, if less than `nearest`; else `nearest`.
fn enter(faces: &[Plane], ray: Vec3, nearest: f32) -> f32 {
    let (mut entry, mut exit) = (0.0_f32, nearest);
    for face in faces {
        let speed = face.normal.dot(ray);
        if speed < 0.0 {
            entry = entry.max(face.offset_m / speed);
        } else if speed > 0.0 {
            exit = exit.min(face.offset_m / speed);
        } else if face.offset_m < 0.0 {
            return nearest;
        }
        if entry > exit {
            return nearest;
        }
    }
    if entry > 0.0 { entry } else { nearest }
}

#[cfg(test)]
mod tests {
    use parry3d::query::{Ray, RayCast};
    use parry3d::shape::{ConvexPolyhedron, TriMesh};
    use schema::{Intrinsics, Pose, Purpose, ShapeKind, Solid, Stream};

    use super::*;
    use crate::SceneObject;
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
        Scene { table_z_m: 0.05, objects }
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
