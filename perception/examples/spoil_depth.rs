//! Adds a sensor's noise to a depth image: `spoil_depth KIND FOCAL_PX WIDTH HEIGHT SCENE < CLEAN > SPOILED`, both as
//! 32-bit floats in metres, row after row.

use std::error::Error;
use std::io::{Read, Write};

use perception::{NoiseKind, add_depth_noise};
use schema::{DepthImage, Purpose, Stream};

fn main() -> Result<(), Box<dyn Error>> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let [kind, focal_px, width_px, height_px, scene] = words.as_slice() else {
        return Err("usage: spoil_depth KIND FOCAL_PX WIDTH HEIGHT SCENE < CLEAN > SPOILED".into());
    };
    let kind = NoiseKind::from_name(kind).ok_or("no such kind of noise")?;
    let (width_px, height_px) = (width_px.parse()?, height_px.parse()?);
    let mut bytes = Vec::new();
    std::io::stdin().read_to_end(&mut bytes)?;
    let depth_m: Vec<f32> = bytes.as_chunks().0.iter().map(|four| f32::from_le_bytes(*four)).collect();
    if depth_m.len() != width_px * height_px {
        return Err(format!("expected {} depths, got {}", width_px * height_px, depth_m.len()).into());
    }
    let mut image = DepthImage { width_px, height_px, depth_m };
    let mut stream = Stream::new(0, scene.parse()?, Purpose::DepthNoise, 0);
    add_depth_noise(&mut image, &kind.noise(0.005, focal_px.parse()?), &mut stream);
    let spoiled: Vec<u8> = image.depth_m.iter().flat_map(|depth| depth.to_le_bytes()).collect();
    std::io::stdout().write_all(&spoiled)?;
    Ok(())
}
