//! The generator's config and a gripper's file.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let _ = generator::fuzzing::config(data); // an error is an answer
});
