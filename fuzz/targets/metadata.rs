//! The info, a marker and the manifest of a dataset.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let _ = shards::fuzzing::metadata(data); // an error is an answer
});
