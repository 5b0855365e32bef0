//! The two macros for rows.

/// Makes a struct from rows, with its reader and checks.
///
/// A row is `name: type where limits; or default; by function as kind,`. Limits are a range, or
/// [`above`](crate::above) a number. A key with a default may be left out. `function` reads the value instead of the
/// type's [`Setting::read`](crate::Setting::read), and `kind` says what it reads. `#[serde(…)]` before a row says how
/// the key is stored, if at all. After the struct, `check function` names a check across keys, which runs if all keys
/// are valid on their own.
///
/// ```
/// settings::settings! {
///     /// How the engine is run.
///     #[derive(Debug)]
///     pub struct Physics {
///         /// Steps a second.
///         pub step_rate_hz: f32 where 30.0..=10_000.0,
///         /// Whether an attempt leaves out what decides nothing.
///         pub shortcuts: bool; or false,
///     }
/// }
/// let document = settings::Document::parse("step_rate_hz = 240", "physics.toml".as_ref()).expect("TOML");
/// assert_eq!(document.read::<Physics>().expect("sound").step_rate_hz, 240.0);
/// ```
#[macro_export]
macro_rules! settings {
    (
        $(#[$attribute:meta])*
        $visible:vis struct $name:ident {
            $(
                $(#[doc = $doc:literal])* $(#[serde($($serde:tt)*)])?
                $access:vis $key:ident: $type:ty
                    $(where $limits:expr)? $(; or $default:expr)? $(; by $by:path as $kind:literal)?
            ),* $(,)?
        }
        $(check $check:path)?
    ) => {
        $(#[$attribute])*
        $visible struct $name {
            $($(#[doc = $doc])* $(#[serde($($serde)*)])? $access $key: $type,)*
        }

        impl $crate::Setting for $name {
            type Limits = ();

            fn kind((): &()) -> String {
                "a table".to_owned()
            }

            fn read(value: &$crate::Value, (): &(), reader: &mut $crate::Reader<'_>) -> Option<Self> {
                let table = reader.table(value, &[$(stringify!($key)),*])?;
                $(
                    let limits = $crate::settings!(@limits $type $(, $limits)?);
                    let $key = reader.key::<$type>(
                        table,
                        stringify!($key),
                        &limits,
                        $crate::settings!(@default $($default)?),
                        &$crate::settings!(@kind $type, limits $(, $kind)?),
                        $crate::settings!(@read $type $(, $by)?),
                    );
                )*
                let read = Self { $($key: $key?),* };
                $($check(&read, reader);)?
                Some(read)
            }

            fn add_rows(prefix: &str, default: Option<&Self>, rows: &mut Vec<$crate::Row>) -> bool {
                $(
                    let key = format!("{prefix}{}", stringify!($key));
                    let own: Option<$type> = $crate::settings!(@default $($default)?);
                    let value = own.as_ref().or(default.map(|table| &table.$key));
                    // Before the keys of a table that may be left out, or of a list's tables.
                    let (inside, at) = (format!("{key}."), rows.len());
                    if !$crate::settings!(@rows $type, inside, value, rows $(, $kind)?) {
                        let limits = $crate::settings!(@limits $type $(, $limits)?);
                        let kind = $crate::settings!(@kind $type, limits $(, $kind)?);
                        let default = value.and_then($crate::Setting::written);
                        let meaning = concat!($($doc),*).trim().to_owned();
                        rows.insert(at, $crate::Row { key, kind, default, meaning });
                    }
                )*
                true
            }
        }
    };
    (@limits $type:ty) => {
        <<$type as $crate::Setting>::Limits as ::core::default::Default>::default()
    };
    (@limits $type:ty, $limits:expr) => {
        <<$type as $crate::Setting>::Limits as ::core::convert::From<_>>::from($limits)
    };
    (@kind $type:ty, $limits:ident) => {
        <$type as $crate::Setting>::kind(&$limits)
    };
    (@kind $type:ty, $limits:ident, $kind:literal) => {{
        let _ = &$limits;
        $kind.to_owned()
    }};
    (@rows $type:ty, $prefix:ident, $default:ident, $rows:ident) => {
        <$type as $crate::Setting>::add_rows(&$prefix, $default, $rows)
    };
    (@rows $type:ty, $prefix:ident, $default:ident, $rows:ident, $kind:literal) => {{
        let _ = $prefix;
        false
    }};
    (@default) => {
        None
    };
    (@default $default:expr) => {
        Some($default)
    };
    (@read $type:ty) => {
        <$type as $crate::Setting>::read
    };
    (@read $type:ty, $by:path) => {
        $by
    };
}

/// Makes an enum whose variants have names in files.
#[macro_export]
macro_rules! words {
    (
        $(#[$attribute:meta])*
        $visible:vis enum $name:ident {
            $($(#[doc = $doc:literal])* $word:ident = $text:literal),* $(,)?
        }
    ) => {
        $(#[$attribute])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        $visible enum $name {
            $($(#[doc = $doc])* $word),*
        }

        impl $name {
            /// All of them, in the order of the documentation.
            pub const ALL: [Self; [$($text),*].len()] = [$(Self::$word),*];

            /// The name in files.
            #[must_use]
            pub const fn name(self) -> &'static str {
                match self {
                    $(Self::$word => $text),*
                }
            }

            /// The one with this name.
            #[must_use]
            pub fn from_name(name: &str) -> Option<Self> {
                Self::ALL.into_iter().find(|word| word.name() == name)
            }
        }

        impl $crate::Setting for $name {
            type Limits = ();

            fn kind((): &()) -> String {
                format!("one of {}", Self::ALL.map(Self::name).join(", "))
            }

            fn read(value: &$crate::Value, (): &(), reader: &mut $crate::Reader<'_>) -> Option<Self> {
                let found = value.as_str().and_then(Self::from_name);
                match (found, value.as_str()) {
                    (None, Some(got)) => reader.fault(format_args!("must be {}, got {}", Self::kind(&()), got.escape_debug())),
                    (None, None) => reader.misfit(Self::kind(&()), value),
                    (Some(_), _) => {}
                }
                found
            }

            fn written(&self) -> Option<String> {
                Some(format!("{:?}", self.name()))
            }
        }

        impl $crate::serde::Serialize for $name {
            fn serialize<S: $crate::serde::Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
                serializer.serialize_str(self.name())
            }
        }
    };
}
