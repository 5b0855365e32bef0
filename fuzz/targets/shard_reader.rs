//! A table's file, given to the reader below its checksums, and a mutator that keeps most files readable for a while:
//! it changes pages in place, and the footer so that its length stays right.
#![no_main]

use libfuzzer_sys::{fuzz_mutator, fuzz_target, fuzzer_mutate};

fuzz_target!(|data: &[u8]| {
    let _ = shards::fuzzing::shard_reader(data); // an error is an answer
});

/// The footer's length and the magic bytes.
const TAIL: usize = 8;

fuzz_mutator!(|data: &mut [u8], size: usize, max_size: usize, seed: u32| {
    let Some(footer) = footer(&data[..size]) else { return fuzzer_mutate(data, size, max_size) };
    match seed % 8 {
        0 => return fuzzer_mutate(data, size, max_size),
        1 => change(&mut data[footer..size - TAIL], seed),
        2..5 => change(&mut data[1..footer], seed),
        _ => {
            let room = max_size.saturating_sub(footer + TAIL);
            if room == 0 {
                return fuzzer_mutate(data, size, max_size);
            }
            let mut bytes = data[footer..size - TAIL].to_vec();
            let length = bytes.len();
            bytes.resize(room.max(length), 0);
            let length = fuzzer_mutate(&mut bytes, length, room).min(room);
            data[footer..footer + length].copy_from_slice(&bytes[..length]);
            let end = footer + length;
            data[end..end + 4].copy_from_slice(&(length as u32).to_le_bytes());
            data[end + 4..end + TAIL].copy_from_slice(b"PAR1");
            return end + TAIL;
        }
    }
    size
});

/// Where the footer begins.
fn footer(data: &[u8]) -> Option<usize> {
    let tail = data.len().checked_sub(TAIL)?;
    let length = u32::from_le_bytes(data[tail..].first_chunk().copied()?);
    tail.checked_sub(usize::try_from(length).ok()?).filter(|footer| *footer > 1 && data.ends_with(b"PAR1"))
}

/// Changes a few bytes where they are.
fn change(bytes: &mut [u8], seed: u32) {
    if bytes.is_empty() {
        return;
    }
    let from = (seed / 8).wrapping_mul(0x9E37_79B9) as usize % bytes.len();
    let length = (bytes.len() - from).min(1 + (seed >> 20) as usize % 32);
    fuzzer_mutate(&mut bytes[from..], length, length);
}
