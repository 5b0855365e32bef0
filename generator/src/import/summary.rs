//! An imported object, and what is said of it: warnings, and its entry in the catalogue.

use std::path::PathBuf;

use schema::{Polyhedron, TriangleMesh};
use serde::Serialize;
use simulator::ConvexParts;

use crate::catalogue::object_text;
use crate::measured::Measured;
use crate::mesh::Seams;

/// A larger difference between the volumes of mesh and parts causes a warning.
const VOLUME_SHARE: f64 = 0.15;
/// So does a larger distance of parts from the mesh's surface.
const OFF_M: f64 = 0.002;
/// Decimals of a corner in a catalogue: a tenth of a micrometre.
const DECIMALS: usize = 7;

/// An imported mesh.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ImportedObject {
    /// Its name: the file's without its extension, or a folder's.
    pub name: String,
    /// The file.
    pub file: PathBuf,
    /// Metres per unit of the file.
    pub scale_m: f64,
    /// Triangles with a positive area.
    pub triangles: usize,
    /// Whether it encloses a volume.
    pub is_watertight: bool,
    /// Edges that do not belong to two triangles of opposite direction.
    pub bad_edges: usize,
    /// Full lengths of its bounding box along the file's axes, in metres.
    pub extents_m: [f64; 3],
    /// The middle of that box in the file's frame, in metres: the origin of the catalogue's numbers.
    pub middle_m: [f64; 3],
    /// Volume of the mesh in cubic metres, if it is watertight.
    pub volume_m3: Option<f64>,
    /// Mass in kilograms.
    pub mass_kg: f64,
    /// Friction coefficient.
    pub friction: f32,
    /// Centre of mass in the file's frame, in metres: of the mesh if it is watertight, otherwise of the parts.
    pub centre_of_mass_m: [f64; 3],
    /// Principal moments of inertia about it, in kg m², smallest first; of the mesh or of the parts.
    pub inertia_kg_m2: [f64; 3],
    /// Convex parts.
    pub parts: usize,
    /// Largest number of corners of a part.
    pub part_corners_max: usize,
    /// Largest distance in metres by which the mesh lies outside its simplified parts.
    pub simplified_m: f64,
    /// Largest distance in metres by which its surface lies inside of a part.
    pub filled_m: f64,
    /// The parts' volume as a share of the mesh's.
    pub parts_volume_share: Option<f64>,
    /// The smallest distance between two parallel planes that enclose the object, in metres.
    pub smallest_width_m: f64,
    /// What nobody said, and was guessed.
    pub guesses: Vec<String>,
    /// What is unusual about it, one sentence each.
    pub warnings: Vec<String>,
}

/// What is unusual about an object.
pub(super) fn warnings(object: &ImportedObject, measured: &Measured) -> Vec<String> {
    let of_parts = "its mass, unless given, is that of its hull, its inertia that of its parts";
    let mut warnings = Vec::new();
    if !object.is_watertight {
        let Seams { open_edges, twisted_edges } = measured.seams;
        warnings.push(format!(
            "not watertight: {open_edges} edges do not belong to two triangles, {twisted_edges} have theirs turned against \
             each other; {of_parts}"
        ));
    } else if let Some(share) = measured.confused_share {
        warnings.push(format!(
            "its shells overlap, or one is inside out: {:.1} % of what it encloses; its mass, unless given, is that of all \
             this, its inertia that of its parts",
            100.0 * share
        ));
    } else if object.volume_m3.is_none() {
        warnings.push(format!("watertight, but without a volume; {of_parts}"));
    }
    if measured.was_inside_out {
        warnings.push("its triangles were inside out; they were reversed".to_owned());
    }
    if let Some(share) = object.parts_volume_share.filter(|share| (share - 1.0).abs() > VOLUME_SHARE) {
        let cure = if share > 1.0 {
            "a smaller --tolerance: the parts fill hollows"
        } else {
            "more --corners-max: the parts cut off rounded surfaces"
        };
        warnings.push(format!("the parts have {:.1} % of its volume; {cure}", 100.0 * share));
    }
    let off_m = object.filled_m.max(object.simplified_m);
    if object.parts > 1 && off_m > OFF_M {
        warnings.push(format!(
            "its parts leave its surface by up to {:.1} mm: more --hulls-max or --corners-max",
            1000.0 * off_m
        ));
    }
    warnings
}

/// The object as a catalogue entry. Corners are relative to the centre of the mesh's bounding box.
pub(super) fn catalogue_text(object: &ImportedObject, parts: &ConvexParts, mesh: Option<&TriangleMesh>) -> String {
    let state = match object.parts_volume_share {
        Some(share) => format!("parts with {:.1} % of its volume", 100.0 * share),
        None => "not watertight".to_owned(),
    };
    let file = object.file.display();
    let source = format!("{file}, {} m a unit; {} triangles; {state}", object.scale_m, object.triangles);
    let parts = parts.hulls.iter().map(Polyhedron::corners_m);
    object_text(&object.name, object.mass_kg, object.friction, source, mesh, parts, DECIMALS)
}
