//! The generator's config and a gripper's file.
#![no_main]

#[path = "../../generator/tests/it/fuzzing.rs"]
mod fuzzing;

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let _ = fuzzing::config(data); // an error is an answer
});
