//! Household objects, drawn by seed: kinds of things with their own sizes and materials, made of convex parts.
//!
//! A kind is a short function of a stream (`household/kinds.rs`). An object is a pure function of seed, kind and its
//! number among the objects of that kind, so other kinds and other counts leave it as it is. The kinds are split once
//! and for all: networks learn from some, and are tested on kinds that they never saw.

mod blocks;
mod kinds;

use schema::{MODELS_MAX, Purpose, Stream};
use settings::{settings, words};
use simulator::hull_volume_m3;

use crate::catalogue::object_text;
use blocks::Part;
use kinds::Draw;

words! {
    /// Which kinds are drawn.
    pub enum Split {
        /// Those that networks learn from.
        Train = "train",
        /// Those that are kept for tests: no shipped config draws them.
        HeldOut = "held-out",
        /// Both.
        All = "all",
    }
}

words! {
    /// A kind of household objects.
    pub enum Kind {
        /// A tumbler, wider at the top.
        Cup = "cup",
        /// A round bowl.
        Bowl = "bowl",
        /// A full bottle with a cap, round or rather square.
        Bottle = "bottle",
        /// A full jar with a lid.
        Jar = "jar",
        /// A thin, flat dish.
        Saucer = "saucer",
        /// A small pan with a handle.
        Pan = "pan",
        /// A ladle with a rising handle.
        Ladle = "ladle",
        /// A bent bar, like a pipe's elbow.
        Elbow = "elbow",
        /// A box with a lid that stands over.
        Carton = "carton",
        /// An open box.
        Crate = "crate",
        /// A superellipsoid, between a ball, a block and a coin.
        Pebble = "pebble",
        /// A screwdriver.
        Screwdriver = "screwdriver",
        /// A brush with a block of bristles.
        Brush = "brush",
        /// A banana.
        Banana = "banana",
        /// A funnel, open at both ends.
        Funnel = "funnel",
        /// A spool with two flanges.
        Spool = "spool",
        /// A goblet on a thin stem.
        Goblet = "goblet",
        /// A board with a tab.
        Board = "board",
        /// A mug with a handle.
        Mug = "mug",
        /// A light bulb.
        Bulb = "bulb",
        /// A ring, thin or thick.
        Ring = "ring",
        /// A profile like an L, a T or a U.
        Bracket = "bracket",
        /// A boot with a hollow shaft.
        Boot = "boot",
        /// A hammer.
        Hammer = "hammer",
        /// A knob with three to five arms on a stem.
        Knob = "knob",
        /// A basket with a bow.
        Basket = "basket",
        /// An open spanner with an eye at its other end.
        Wrench = "wrench",
    }
}

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

/// What an object is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Material {
    name: &'static str,
    /// Mass of the parts by their volume; of a full or an empty body, on average.
    density_kg_m3: f32,
    /// Coulomb friction coefficient, uniform.
    friction: [f32; 2],
}

const fn material(name: &'static str, density_kg_m3: f32, friction: [f32; 2]) -> Material {
    Material { name, density_kg_m3, friction }
}

const CERAMIC: Material = material("ceramic", 2300.0, [0.6, 0.8]);
const GLASS: Material = material("glass", 2500.0, [0.5, 0.7]);
const PLASTIC: Material = material("plastic", 1050.0, [0.6, 0.9]);
const STEEL: Material = material("steel", 7800.0, [0.5, 0.7]);
const ALUMINIUM: Material = material("aluminium", 2700.0, [0.5, 0.7]);
const WOOD: Material = material("wood", 650.0, [0.7, 0.9]);
const RUBBER: Material = material("rubber", 1150.0, [0.9, 1.2]);
const STONE: Material = material("stone", 2400.0, [0.7, 0.9]);
const FRUIT: Material = material("fruit", 950.0, [0.7, 1.0]);
const CARD: Material = material("card, full", 400.0, [0.7, 0.9]);
const FULL: Material = material("plastic, full", 950.0, [0.6, 0.8]);
const EMPTY: Material = material("glass, empty", 250.0, [0.6, 0.8]);

/// Draws the convex parts of an object of a kind.
type Shaper = fn(&mut Draw) -> Vec<Part>;

impl Kind {
    /// Whether it is kept for tests.
    #[must_use]
    pub fn is_held_out(self) -> bool {
        use Kind::{Basket, Boot, Bracket, Bulb, Hammer, Knob, Mug, Ring, Wrench};
        matches!(self, Mug | Bulb | Ring | Bracket | Boot | Hammer | Knob | Basket | Wrench)
    }

    /// How its parts are drawn, and its materials, one of which is drawn.
    fn recipe(self) -> (Shaper, &'static [Material]) {
        match self {
            Self::Cup => (kinds::cup, &[PLASTIC, CERAMIC, GLASS]),
            Self::Bowl => (kinds::bowl, &[CERAMIC, PLASTIC, WOOD]),
            Self::Bottle => (kinds::bottle, &[FULL, EMPTY]),
            Self::Jar => (kinds::jar, &[FULL, EMPTY]),
            Self::Saucer => (kinds::saucer, &[CERAMIC, PLASTIC]),
            Self::Pan => (kinds::pan, &[ALUMINIUM, CERAMIC]),
            Self::Ladle => (kinds::ladle, &[PLASTIC, WOOD, ALUMINIUM]),
            Self::Elbow => (kinds::elbow, &[PLASTIC, RUBBER, WOOD]),
            Self::Carton => (kinds::carton, &[CARD, WOOD]),
            Self::Crate => (kinds::open_box, &[WOOD, PLASTIC]),
            Self::Pebble => (kinds::pebble, &[STONE, RUBBER, WOOD]),
            Self::Screwdriver => (kinds::screwdriver, &[PLASTIC, STEEL]),
            Self::Brush => (kinds::brush, &[WOOD, PLASTIC]),
            Self::Banana => (kinds::banana, &[FRUIT]),
            Self::Funnel => (kinds::funnel, &[PLASTIC, ALUMINIUM]),
            Self::Spool => (kinds::spool, &[WOOD, PLASTIC]),
            Self::Goblet => (kinds::goblet, &[GLASS, WOOD]),
            Self::Board => (kinds::board, &[WOOD, PLASTIC]),
            Self::Mug => (kinds::mug, &[CERAMIC, PLASTIC]),
            Self::Bulb => (kinds::bulb, &[EMPTY]),
            Self::Ring => (kinds::ring, &[RUBBER, WOOD, ALUMINIUM]),
            Self::Bracket => (kinds::bracket, &[ALUMINIUM, STEEL, PLASTIC]),
            Self::Boot => (kinds::boot, &[RUBBER, EMPTY]),
            Self::Hammer => (kinds::hammer, &[WOOD, RUBBER, ALUMINIUM]),
            Self::Knob => (kinds::knob, &[PLASTIC, ALUMINIUM]),
            Self::Basket => (kinds::basket, &[WOOD, PLASTIC]),
            Self::Wrench => (kinds::wrench, &[STEEL, ALUMINIUM]),
        }
    }

    /// The `number`-th object of this kind: its parts, its material and its friction.
    fn draw(self, seed: u64, number: u64) -> (Vec<Part>, Material, f32) {
        let mut draw = Draw(Stream::new(seed, number, Purpose::Household, self as u32));
        let (parts, materials) = self.recipe();
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
