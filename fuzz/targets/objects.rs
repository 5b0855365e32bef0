//! Files that objects are imported from: meshes.
#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| {
    let _ = generator::fuzzing::object(data); // an error is an answer
});
