//! Reading hostile files: what the fuzz targets call, and files that once did harm.

pub mod fuzzing;
#[cfg(test)]
mod hostile;
