//! Depth by ray casting.
//!
//! Every solid is an intersection of half-spaces, so a ray meets it where it has entered all of them and left none:
//! a dozen multiplications a face, exact, and the same faceted shapes as in the physics. A ray is cast for a pixel only
//! when someone asks for that pixel, which is how the TSDF comes to cost a fraction of a rendered image.

use schema::{Camera, DepthImage, Plane, Vec3};

use crate::Scene;

/// A scene made ready for rays.
#[derive(Debug, Clone)]
pub struct SceneRays {
    table_z_m: f32,
    bodies: Vec<Body>,
}

#[derive(Debug, Clone)]
struct Body {
    centre_m: Vec3,
    radius_squared_m2: f32,
    /// In the workspace.
    planes: Vec<Plane>,
}

impl SceneRays {
    /// Makes a scene ready for rays.
    #[must_use]
    pub fn new(scene: &Scene) -> Self {
        let bodies = scene
            .objects
            .iter()
            .map(|object| {
                let pose = object.workspace_from_object;
                let planes = object
                    .solid
                    .planes()
                    .into_iter()
                    .map(|plane| {
                        let normal = pose.rotation * plane.normal;
                        Plane { normal, offset_m: plane.offset_m + normal.dot(pose.translation) }
                    })
                    .collect();
                let radius = object.solid.bounding_radius_m();
                Body { centre_m: pose.translation, radius_squared_m2: radius * radius, planes }
            })
            .collect();
        Self { table_z_m: scene.table_z_m, bodies }
    }

    /// How far along `direction` the first thing is met, in units of its length; `None` if nothing is.
    #[must_use]
    pub fn cast(&self, origin_m: Vec3, direction: Vec3) -> Option<f32> {
        let mut nearest = f32::INFINITY;
        if direction.z < 0.0 && origin_m.z > self.table_z_m {
            nearest = (self.table_z_m - origin_m.z) / direction.z;
        }
        let length_squared = direction.length_squared();
        for body in &self.bodies {
            let to_centre = body.centre_m - origin_m;
            let along = to_centre.dot(direction);
            let miss_squared = to_centre.length_squared() - along * along / length_squared;
            if along > 0.0 && miss_squared <= body.radius_squared_m2 {
                nearest = enter(&body.planes, origin_m, direction, nearest);
            }
        }
        nearest.is_finite().then_some(nearest)
    }

    /// Depth along the camera's z at a pixel, in metres; `None` where nothing is seen.
    #[must_use]
    pub fn depth_at(&self, camera: &Camera, pixel: [usize; 2]) -> Option<f32> {
        let pose = camera.workspace_from_camera;
        self.cast(pose.translation, pose.rotation * camera.intrinsics.ray(pixel))
    }

    /// The whole depth image.
    #[must_use]
    pub fn render(&self, camera: &Camera) -> DepthImage {
        let (width_px, height_px) = (camera.intrinsics.width_px, camera.intrinsics.height_px);
        let depth_m = (0..width_px * height_px)
            .map(|i| self.depth_at(camera, [i % width_px, i / width_px]).unwrap_or(0.0))
            .collect();
        DepthImage { width_px, height_px, depth_m }
    }
}

/// Where the ray enters the solid that `planes` bound, if before `nearest`; else `nearest`.
fn enter(planes: &[Plane], origin_m: Vec3, direction: Vec3, nearest: f32) -> f32 {
    let (mut entry, mut exit) = (0.0_f32, nearest);
    for plane in planes {
        let speed = plane.normal.dot(direction);
        let gap = plane.offset_m - plane.normal.dot(origin_m);
        if speed < 0.0 {
            entry = entry.max(gap / speed);
        } else if speed > 0.0 {
            exit = exit.min(gap / speed);
        } else if gap < 0.0 {
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
                    solid: Solid::new(kind, extents).unwrap(),
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

    /// Depths agree with parry's rays against the triangles of the physics' shapes. (Against the convex hulls themselves
    /// parry casts by GJK, which stops up to some millimetres off a faceted cylinder.)
    #[test]
    fn rays_meet_what_the_physics_feels() {
        let scene = scene_of_all_shapes();
        let rays = SceneRays::new(&scene);
        let meshes: Vec<TriMesh> = scene.objects.iter().map(|o| triangles_of(&o.solid)).collect();
        let mut stream = Stream::new(12, 0, Purpose::Views, 0);
        let (mut on_objects, mut disagreements) = (0, 0);
        for _ in 0..20_000 {
            let origin = Vec3::new(stream.uniform(-0.2, 0.5), stream.uniform(-0.2, 0.5), stream.uniform(0.3, 0.7));
            let aim = stream.point(Vec3::new(0.0, 0.0, 0.05), Vec3::new(0.3, 0.3, 0.16));
            let direction = aim - origin;
            let ray = Ray::new(origin, direction);
            let expected = meshes
                .iter()
                .zip(&scene.objects)
                .filter_map(|(mesh, o)| mesh.cast_ray(&o.workspace_from_object, &ray, 100.0, true))
                .fold((0.05 - origin.z) / direction.z, f32::min);
            let got = rays.cast(origin, direction).unwrap();
            on_objects += u32::from(expected < (0.049 - origin.z) / direction.z * 0.98);
            // A ray along a silhouette may hit for one and miss for the other.
            disagreements += u32::from((got - expected).abs() * direction.length() > 2e-5);
        }
        assert!(on_objects > 3_000, "only {on_objects} rays met an object");
        assert!(disagreements <= 10, "{disagreements} of 20000 rays disagree");
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
        assert_eq!(image.at([10, 7]), rays.depth_at(&camera, [10, 7]));
        assert!((image.at([0, 0]).unwrap() - 0.55).abs() < 1e-5, "the table lies 0.55 m below");
        assert!(image.depth_m.iter().any(|d| *d < 0.5), "some object rises above the table");
    }

    #[test]
    fn a_ray_into_the_sky_meets_nothing() {
        assert_eq!(SceneRays::new(&scene_of_all_shapes()).cast(Vec3::new(0.15, 0.15, 0.5), Vec3::Z), None);
    }
}
