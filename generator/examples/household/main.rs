//! Draws the household objects of `configs/objects`: kinds of things with their own sizes and materials, made of convex
//! parts.
//!
//!     cargo run --release --example household -- train 920 1 | zstd --ultra -22 > household-train.toml.zst
//!
//! A kind is a row of a table (`table.rs`) and a short function of a stream. An object is a pure function of seed, kind
//! and its number among the objects of that kind, so other kinds and other counts leave it as it is. The kinds are
//! split once and for all: networks learn from some, and are tested on kinds that they never saw.

mod blocks;
mod kinds;
mod table;
mod tools;
mod toys;
mod vessels;

use std::env::args;
use std::io::{Write as _, stdout};

use generator::catalogue::object_text;
use schema::{Purpose, Stream};
use simulator::hull_volume_m3;

use blocks::Part;
use kinds::Draw;
use table::{Kind, Material, Split};

fn main() -> Result<(), String> {
    let usage = || "household train|held-out COUNT SEED".to_owned();
    let words: Vec<String> = args().skip(1).collect();
    let [split, count, seed] = &words[..] else { return Err(usage()) };
    let split = Split::from_name(split).ok_or_else(usage)?;
    let (count, seed) = (count.parse().map_err(|_| usage())?, seed.parse().map_err(|_| usage())?);
    stdout().write_all(household(split, count, seed).as_bytes()).map_err(|error| error.to_string())
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

/// The text of a catalogue of so many household objects; the kinds of the split take turns.
fn household(split: Split, count: usize, seed: u64) -> String {
    let wanted: Vec<Kind> =
        Kind::ALL.into_iter().filter(|kind| kind.is_held_out() == (split == Split::HeldOut)).collect();
    let mut text = HEAD.to_owned();
    for (turn, kind) in (0..count).zip(wanted.iter().cycle()) {
        let number = turn / wanted.len();
        let (parts, Material { name, density_kg_m3, .. }, friction) = kind.draw(seed, number as u64);
        let volume_m3: f64 = parts.iter().flat_map(|part| hull_volume_m3(part)).sum();
        let mass_kg = f64::from(density_kg_m3) * volume_m3;
        let source = format!("{} {number} of seed {seed}; {name}, {density_kg_m3} kg/m3", kind.name());
        let name = format!("{}_{number:03}", kind.name());
        text += &object_text(&name, mass_kg, friction, source, None, parts.iter().map(Vec::as_slice), DECIMALS);
    }
    text
}

/// Decimals of a corner: those of single precision, so that four corners of a flat face are in one plane.
const DECIMALS: usize = 9;

const HEAD: &str = "\
# Household objects drawn by `generator make-objects`; configs/objects/everyday.toml says what the keys mean.
";

#[cfg(test)]
mod tests;
