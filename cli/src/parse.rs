//! How arguments are read that clap does not know.

/// A parser of an enumeration of `words!`: its names are the possible values.
macro_rules! one_of {
    ($words:ty) => {
        clap::builder::TypedValueParser::try_map(
            clap::builder::PossibleValuesParser::new(<$words>::ALL.map(<$words>::name)),
            |name| <$words>::from_name(&name).ok_or("no such name"),
        )
    };
}
pub(crate) use one_of;

#[cfg(feature = "full")]
pub(crate) use location::LocationParser;

#[cfg(feature = "full")]
mod location {
    use std::ffi::OsStr;

    use clap::builder::TypedValueParser;
    use clap::error::ErrorKind;
    use clap::{Arg, Command, Error};
    use shards::Location;

    /// Reads a [`Location`]. An error leaves out the text, which may hold a secret.
    #[derive(Debug, Clone, Copy)]
    pub(crate) struct LocationParser;

    impl TypedValueParser for LocationParser {
        type Value = Location;

        fn parse_ref(&self, command: &Command, argument: Option<&Arg>, value: &OsStr) -> Result<Location, Error> {
            Location::parse(value).map_err(|error| {
                let name = argument.map(ToString::to_string).unwrap_or_default();
                Error::raw(ErrorKind::ValueValidation, format!("invalid value for '{name}': {error}\n"))
                    .with_cmd(command)
            })
        }
    }
}
