//! Depth from `OpenEXR` files. The `exr` crate decodes them block by block. Its own limits are made for film, so files
//! are first checked to be depth images (one part, one level, few channels, no lossy compression). A panic of the
//! decoder becomes an error.

use std::io::Cursor;
use std::panic::catch_unwind;

use exr::block::lines::LineRef;
use exr::block::reader::ChunksReader;
use exr::error::Error;
use exr::meta::BlockDescription;
use exr::meta::attribute::{ChannelList, IntegerBounds, LevelMode, SampleType};
use exr::meta::header::Header;
use exr::prelude::{Compression, Vec2, f16};

use crate::input::error::{InputError, refuse, shown};
use crate::input::raw_depth::{RawDepth, SIDE_PX_MAX, check_size};

/// Colours, depth, and a few masks.
const CHANNELS_MAX: usize = 8;
/// Bytes of a complete image in single precision, which also limit one tile.
const BLOCK_BYTES_MAX: usize = 4 * SIDE_PX_MAX * SIDE_PX_MAX;
/// Minimum bytes per block in a file: an entry in the offset table, its coordinates, its length.
const BLOCK_FILE_BYTES_MIN: usize = 16;

/// Reads the depth channel: the only one, or that called `Z`, `depth`, `Y` or `R`, in this order.
pub(crate) fn read_exr(bytes: &[u8], pixels_max: usize) -> Result<RawDepth, InputError> {
    let caught = catch_unwind(|| decode(bytes, pixels_max));
    caught.unwrap_or_else(|_| Err(InputError::Damaged("the EXR's pixels cannot be decoded".to_owned())))
}

fn damaged(error: Error) -> InputError {
    InputError::Damaged(format!("not a whole EXR that can be read: {}", shown(&error.to_string())))
}

fn decode(bytes: &[u8], pixels_max: usize) -> Result<RawDepth, InputError> {
    let reader = exr::block::read(Cursor::new(bytes), false).map_err(damaged)?;
    let [header] = reader.headers() else {
        return refuse(format!("a depth EXR must have one part, got {}", reader.headers().len()));
    };
    check_header(header, bytes.len(), pixels_max)?;
    let channels = header.channels.clone();
    let chosen = depth_channel(&channels)?;
    let kind = channels.list[chosen].sample_type;
    let Vec2(width_px, height_px) = header.layer_size;
    let mut values = vec![0.0; width_px * height_px];
    let mut filled = 0;
    let mut blocks = reader.all_chunks(false).map_err(damaged)?.sequential_decompressor(false);
    while let Some(block) = blocks.decompress_next_block() {
        let block = block.map_err(damaged)?;
        for line in block.lines(&channels).filter(|line| line.location.channel == chosen) {
            filled += put_line(&line, kind, width_px, &mut values)?;
        }
    }
    if filled == values.len() {
        return Ok(RawDepth { width_px, height_px, values, are_whole_numbers: kind == SampleType::U32 });
    }
    Err(InputError::Damaged(format!("the EXR must have {} pixels, got {filled}", values.len())))
}

fn check_header(header: &Header, file_bytes: usize, pixels_max: usize) -> Result<(), InputError> {
    check_size(header.layer_size.0, header.layer_size.1, pixels_max)?;
    let (data, display) = (header.data_window(), header.shared_attributes.display_window);
    if data != display {
        let (wanted, got) = (corners(display), corners(data));
        return refuse(format!(
            "the data window must be the display window {wanted}, got {got}: a cropped image moves the principal point"
        ));
    }
    if let BlockDescription::Tiles(tiles) = header.blocks {
        let Vec2(width, height) = tiles.tile_size;
        if tiles.level_mode != LevelMode::Singular || width > SIDE_PX_MAX || height > SIDE_PX_MAX {
            return refuse(format!("a depth EXR must have one level and tiles of at most {SIDE_PX_MAX} pixels a side"));
        }
    }
    if header.channels.list.len() > CHANNELS_MAX || header.channels.list.iter().any(|c| c.sampling != Vec2(1, 1)) {
        return refuse(format!("a depth EXR must have at most {CHANNELS_MAX} channels, none of them subsampled"));
    }
    if header.max_block_byte_size() > BLOCK_BYTES_MAX {
        return refuse(format!("a depth EXR must have blocks of at most {BLOCK_BYTES_MAX} bytes"));
    }
    let is_faithful = matches!(
        header.compression,
        Compression::Uncompressed
            | Compression::RLE
            | Compression::ZIP1
            | Compression::ZIP16
            | Compression::PIZ
            | Compression::PXR24
    );
    if !is_faithful {
        let lossless = "a depth EXR must be uncompressed, RLE, ZIP, PIZ or PXR24";
        return refuse(format!("{lossless}, got {}, which spoils depth", header.compression));
    }
    if header.chunk_count.saturating_mul(BLOCK_FILE_BYTES_MIN) > file_bytes {
        let blocks = header.chunk_count;
        return Err(InputError::Damaged(format!("an EXR of {file_bytes} bytes cannot hold its {blocks} blocks")));
    }
    Ok(())
}

/// A window's first and last pixel.
fn corners(window: IntegerBounds) -> String {
    let Vec2(left, top) = window.position;
    let last = |first: i32, count: usize| i64::from(first) + count as i64 - 1;
    format!("({left},{top})-({},{})", last(left, window.size.0), last(top, window.size.1))
}

/// The depth channel; a layer's name before a dot is ignored.
fn depth_channel(channels: &ChannelList) -> Result<usize, InputError> {
    let names: Vec<String> = channels.list.iter().map(|channel| channel.name.to_string()).collect();
    let last = |name: &str| name.rsplit('.').next().unwrap_or_default().to_ascii_lowercase();
    let named = ["z", "depth", "y", "r"].iter().find_map(|wanted| names.iter().position(|name| last(name) == *wanted));
    let only = (names.len() == 1).then_some(0);
    named.or(only).ok_or_else(|| {
        let got = shown(&names.join(", "));
        InputError::Value(format!("a depth EXR must have one channel, or one called Z, depth, Y or R, got {got}"))
    })
}

/// Copies a line of samples to its row; returns their number.
fn put_line(line: &LineRef<'_>, kind: SampleType, width_px: usize, values: &mut [f32]) -> Result<usize, InputError> {
    let Vec2(u, v) = line.location.position;
    let count = line.location.sample_count;
    let is_inside = line.location.level == Vec2(0, 0) && u + count <= width_px;
    let first = v * width_px + u;
    let row = values.get_mut(first..first + count).filter(|_| is_inside);
    let row = row.ok_or_else(|| InputError::Damaged("a block of the EXR lies outside the image".to_owned()))?;
    match kind {
        SampleType::F32 => fill(row, line.value, f32::from_ne_bytes),
        SampleType::F16 => fill(row, line.value, |bytes| f16::from_ne_bytes(bytes).to_f32()),
        SampleType::U32 => fill(row, line.value, |bytes| u32::from_ne_bytes(bytes) as f32),
    }
    Ok(count)
}

fn fill<const N: usize>(row: &mut [f32], bytes: &[u8], convert: impl Fn([u8; N]) -> f32) {
    for (value, bytes) in row.iter_mut().zip(bytes.as_chunks::<N>().0) {
        *value = convert(*bytes);
    }
}

#[cfg(test)]
mod tests {
    use exr::image::{Encoding, FlatSamples};

    use super::*;
    use crate::input::tests::exr_of;

    fn read_whole(bytes: &[u8]) -> Result<RawDepth, InputError> {
        read_exr(bytes, usize::MAX)
    }

    fn ramp() -> Vec<f32> {
        (0..15).map(|i: u16| 0.25 * f32::from(i)).collect()
    }

    #[test]
    fn every_encoding_and_sample_type_gives_the_same_depths() {
        let encodings =
            [Encoding::UNCOMPRESSED, Encoding::FAST_LOSSLESS, Encoding::SMALL_LOSSLESS, Encoding::SMALL_FAST_LOSSLESS];
        for encoding in encodings {
            let half = ramp().iter().map(|depth| f16::from_f32(*depth)).collect();
            for samples in [FlatSamples::F32(ramp()), FlatSamples::F16(half)] {
                let read = read_whole(&exr_of(encoding, vec![("Z", samples)])).unwrap();
                assert_eq!((read.width_px, read.height_px, read.are_whole_numbers), (5, 3, false));
                assert_eq!(read.values, ramp(), "quarters are exact in both, {encoding:?}");
            }
        }
        let whole = FlatSamples::U32((0..15).collect());
        let read = read_whole(&exr_of(Encoding::SMALL_LOSSLESS, vec![("depth.V", whole)])).unwrap();
        assert!(read.are_whole_numbers && read.values.iter().map(|value| 0.25 * value).eq(ramp()));
    }

    #[test]
    fn the_depth_channel_is_found_by_its_name() {
        let other = || FlatSamples::F32(vec![9.0; 15]);
        let mine = || FlatSamples::F32(ramp());
        for (names, is_found) in
            [(["A", "ViewLayer.Depth.Z"], true), (["A", "Depth"], true), (["G", "R"], true), (["G", "B"], false)]
        {
            let bytes = exr_of(Encoding::UNCOMPRESSED, vec![(names[0], other()), (names[1], mine())]);
            match read_whole(&bytes) {
                Ok(read) => assert!(is_found && read.values == ramp(), "{names:?}"),
                Err(error) => assert!(!is_found && error.to_string().contains("got B, G"), "{error}"),
            }
        }
    }

    #[test]
    fn lossy_and_cut_files_are_refused() {
        let lossy = Encoding { compression: Compression::B44, ..Encoding::UNCOMPRESSED };
        let half = FlatSamples::F16(vec![f16::from_f32(1.0); 15]);
        let message = read_whole(&exr_of(lossy, vec![("Z", half)])).unwrap_err().to_string();
        assert!(message.contains("got b44 compression"), "{message}");
        let whole = exr_of(Encoding::SMALL_LOSSLESS, vec![("Z", FlatSamples::F32(ramp()))]);
        for end in 4..whole.len() {
            assert!(matches!(read_whole(&whole[..end]), Err(InputError::Damaged(_))), "cut at {end}");
        }
    }

    /// Writes left, top, right, bottom over a window of the header.
    fn put_window(bytes: &mut [u8], name: &str, corners: [i32; 4]) {
        let name = format!("{name}\0box2i\0").into_bytes();
        let at = bytes.windows(name.len()).position(|window| window == name).unwrap() + name.len() + 4;
        bytes[at..at + 16].copy_from_slice(&corners.map(i32::to_le_bytes).concat());
    }

    #[test]
    fn a_cropped_image_is_refused() {
        let whole = exr_of(Encoding::UNCOMPRESSED, vec![("Z", FlatSamples::F32(ramp()))]);
        let message = |window: &str, corners: [i32; 4]| {
            let mut bytes = whole.clone();
            put_window(&mut bytes, window, corners);
            read_whole(&bytes).unwrap_err().to_string()
        };
        let expected = "the data window must be the display window (0,0)-(639,479), got (0,0)-(4,2): a cropped image";
        assert!(message("displayWindow", [0, 0, 639, 479]).starts_with(expected));
        assert!(message("displayWindow", [-1, 0, 3, 2]).contains("display window (-1,0)-(3,2), got (0,0)-(4,2)"));
        assert!(message("dataWindow", [10, 20, 14, 22]).contains("got (10,20)-(14,22)"));
    }

    #[test]
    fn a_huge_data_window_is_refused_from_the_header() {
        let mut bytes = exr_of(Encoding::UNCOMPRESSED, vec![("Z", FlatSamples::F32(ramp()))]);
        for side in [4096, 1_000_000, i32::MAX - 1] {
            put_window(&mut bytes, "dataWindow", [0, 0, side - 1, side - 1]);
            put_window(&mut bytes, "displayWindow", [0, 0, side - 1, side - 1]);
            let message = read_whole(&bytes).unwrap_err().to_string();
            assert!(!message.contains("display window"), "{side}: {message}");
        }
    }
}
