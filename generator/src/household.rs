//! Household objects, drawn by seed: kinds of things with their own sizes and materials, made of convex parts.
//!
//! A kind is a row of a table (`household/table.rs`) and a short function of a stream. An object is a pure function of
//! seed, kind and its number among the objects of that kind, so other kinds and other counts leave it as it is. The
//! kinds are split once and for all: networks learn from some, and are tested on kinds that they never saw.

mod blocks;
mod kinds;
mod table;
mod tools;
mod toys;
mod vessels;

use schema::{MODELS_MAX, Purpose, Stream};
use settings::settings;
use simulator::hull_volume_m3;

use crate::catalogue::object_text;
use blocks::Part;
use kinds::Draw;
use table::Material;
pub use table::{Kind, Split};

settings! {
    /// A catalogue of household objects that is drawn instead of read.
    #[derive(Debug, Clone, PartialEq, Eq)]
    pub struct HouseholdParams {
        /// Which kinds.
        pub split: Split,
        /// Only these kinds of the split; without the key all of them.
        pub kinds: Vec<Kind>; or Vec::new(),
        /// Number of objects; the kinds take turns.
        pub count: usize where 1..=MODELS_MAX,
        /// Seed of every object.
        pub seed: u64,
    }
}

impl HouseholdParams {
    /// The kinds that are drawn, or what is wrong with them.
    fn wanted(&self) -> Result<Vec<Kind>, String> {
        let is_of_split =
            |kind: &Kind| self.split == Split::All || (self.split == Split::HeldOut) == kind.is_held_out();
        if let Some(other) = self.kinds.iter().find(|kind| !is_of_split(kind)) {
            return Err(format!("kinds must be of the split {}, got {}", self.split.name(), other.name()));
        }
        let all = Kind::ALL.into_iter().filter(is_of_split).collect();
        Ok(if self.kinds.is_empty() { all } else { self.kinds.clone() })
    }
}

impl Kind {
    /// The `number`-th object of this kind: its parts, its material and its friction.
    fn draw(self, seed: u64, number: u64) -> (Vec<Part>, Material, f32) {
        let mut draw = Draw(Stream::new(seed, number, Purpose::Household, self as u32));
        let (_, parts, materials) = self.recipe();
        let material = materials[draw.0.index(materials.len())];
        let friction = draw.0.uniform(material.friction[0], material.friction[1]);
        (parts(&mut draw), material, (100.0 * friction).round() / 100.0)
    }
}

/// The text of a catalogue of household objects.
///
/// # Errors
/// If a kind is not of the split.
pub fn household(params: &HouseholdParams) -> Result<String, String> {
    let wanted = params.wanted()?;
    let (seed, mut text) = (params.seed, HEAD.to_owned());
    for (turn, kind) in (0..params.count).zip(wanted.iter().cycle()) {
        let number = turn / wanted.len();
        let (parts, Material { name, density_kg_m3, .. }, friction) = kind.draw(seed, number as u64);
        let volume_m3: f64 = parts.iter().flat_map(|part| hull_volume_m3(part)).sum();
        let mass_kg = f64::from(density_kg_m3) * volume_m3;
        let source = format!("{} {number} of seed {seed}; {name}, {density_kg_m3} kg/m3", kind.name());
        let name = format!("{}_{number:03}", kind.name());
        text += &object_text(&name, mass_kg, friction, source, parts.iter().map(Vec::as_slice), DECIMALS);
    }
    Ok(text)
}

/// Decimals of a corner: those of single precision, so that four corners of a flat face are in one plane.
const DECIMALS: usize = 9;

const HEAD: &str = "\
# Household objects drawn by `generator make-objects`; configs/objects/everyday.toml says what the keys mean.
";

#[cfg(test)]
mod tests;
