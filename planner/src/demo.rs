//! The built-in scene: three depth images of objects on a table.

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

use crate::input::{DataInput, InputError, RequestInput, SourceInput, parse_toml};

const VIEWS: &[u8] = include_bytes!("../demo/views.toml");
/// Its files, in its order.
const IMAGES: [&[u8]; 3] = [
    include_bytes!("../demo/depth-0.png"),
    include_bytes!("../demo/depth-1.png"),
    include_bytes!("../demo/depth-2.png"),
];

/// The request of `graspmill plan --demo`, the same as that of `graspmill plan --views planner/demo/views.toml`.
///
/// # Errors
/// Never, as a test shows; the type is that of other requests.
pub fn request() -> Result<RequestInput, InputError> {
    let mut input: RequestInput = parse_toml(VIEWS)?;
    for (view, image) in input.views.iter_mut().flatten().zip(IMAGES) {
        view.depth = SourceInput::Data(DataInput { data: STANDARD.encode(image) });
    }
    Ok(input)
}

#[cfg(test)]
mod tests {
    use schema::Grid;

    use super::*;
    use crate::input::{assemble, from_file};

    #[test]
    fn the_demo_is_what_its_folder_says() {
        let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("demo/views.toml");
        assert_eq!(
            assemble(&request().unwrap(), None, Grid::PAPER).unwrap(),
            from_file(&path, Grid::PAPER, |_| ()).unwrap()
        );
    }
}
