//! The trainer's recipe.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let _ = trainer::fuzzing::config(data); // an error is an answer
});
