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
pub(crate) use full::{Elsewhere, LocationParser, between, others_do};

#[cfg(feature = "full")]
mod full {
    use std::ffi::OsStr;
    use std::fmt::Display;
    use std::ops::RangeInclusive;
    use std::str::FromStr;

    use clap::builder::TypedValueParser;
    use clap::error::ErrorKind;
    use clap::{Arg, Args, Command, Error};
    use program::{ExitCode, Failure};
    use shards::Location;

    /// A parser of a number within limits.
    pub(crate) fn between<T: FromStr + PartialOrd + Display + Clone>(
        range: RangeInclusive<T>,
    ) -> impl Fn(&str) -> Result<T, String> + Clone {
        move |text| {
            let read = text.parse::<T>().ok().filter(|value| range.contains(value));
            read.ok_or_else(|| format!("must be between {} and {}, got {text}", range.start(), range.end()))
        }
    }

    /// The failure of a command that the program of the Python package has, with some of its extras.
    pub(crate) fn others_do(what: &str, extras: &str) -> Failure {
        let text = format!(
            "the program of the Python package {what}: pip install graspmill{extras}, then run the same command"
        );
        Failure::new(ExitCode::Usage, text)
    }

    // Its variant says what the command does.
    #[derive(Debug, Args)]
    #[command(disable_help_flag = true)]
    pub(crate) struct Elsewhere {
        /// As the program of the Python package takes them.
        #[arg(hide = true, trailing_var_arg = true, allow_hyphen_values = true)]
        _words: Vec<String>,
    }

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
