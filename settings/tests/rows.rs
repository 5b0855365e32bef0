//! Settings made of rows: what is read, what is refused, and how a refusal reads.

use std::path::Path;

use settings::{Document, Error, above, faults_of, read_stored, rows_of, settings, words};

words! {
    /// A colour.
    pub enum Colour {
        /// As blood.
        Red = "red",
        /// As the sea.
        Blue = "blue",
    }
}

settings! {
    /// All kinds of keys.
    #[derive(Debug, Clone, PartialEq, serde::Serialize)]
    pub struct All {
        /// A whole number
        /// of two lines.
        pub count: u32 where 1..=10,
        /// A share.
        pub share: f32 where above(0.0, 0.5),
        /// A colour.
        pub colour: Colour,
        /// Off.
        pub is_on: bool; or false,
        /// A file.
        pub file: Option<String>; or None,
        /// Inner keys.
        pub inner: Inner,
    }
}

settings! {
    /// An inner table.
    #[derive(Debug, Clone, PartialEq, serde::Serialize)]
    pub struct Inner {
        /// From, to.
        pub size_m: [f32; 2] where 0.1..=2.0,
        /// One an axis.
        pub weights: [f32; 3] where 0.0..=1.0,
        /// Some.
        pub counts: Vec<u64> where 1..=9,
    }
    check inner_fits
}

fn inner_fits(inner: &Inner, reader: &mut settings::Reader<'_>) {
    reader.must("counts", inner.counts.len() < 4, || format!("must be at most 3 counts, got {}", inner.counts.len()));
}

const GOOD: &str = "count = 3\nshare = 0.5\ncolour = \"blue\"\n\
                    [inner]\nsize_m = [0.5, 1]\nweights = [0, 0.5, 1.0]\ncounts = [1, 2]\n";

fn read(text: &str) -> Result<All, Error> {
    Document::parse(text, Path::new("some.toml"))?.read()
}

fn faults(text: &str) -> Vec<String> {
    match read(text) {
        Err(Error::Invalid { faults, .. }) => faults,
        other => panic!("expected faults, got {other:?}"),
    }
}

#[test]
fn a_sound_text_is_read_and_keys_with_a_default_may_be_left_out() {
    let inner = Inner { size_m: [0.5, 1.0], weights: [0.0, 0.5, 1.0], counts: vec![1, 2] };
    let all = All { count: 3, share: 0.5, colour: Colour::Blue, is_on: false, file: None, inner };
    assert_eq!(read(GOOD).unwrap(), all);
    assert!(read(&format!("is_on = true\nfile = \"x\"\n{GOOD}")).unwrap().is_on);
}

#[test]
fn all_faults_are_reported_at_once_each_with_its_path() {
    let text = "count = 11\nshare = 0\ncolour = \"green\"\nis_on = 1\nfiel = \"x\"\n[inner]\n\
                size_m = [1.0, 0.5]\nweights = [0, nan, 1]\ncounts = [0, 1, 10]\nsomething = 1\n";
    assert_eq!(
        faults(text),
        [
            "fiel is an unknown key, did you mean file?",
            "count must be between 1 and 10, got 11",
            "share must be above 0 and at most 0.5, got 0",
            "colour must be one of red, blue, got green",
            "is_on must be true or false, got 1",
            "inner.something is an unknown key",
            "inner.size_m must be a range [low, high] within [0.1, 2], got [1.0, 0.5]",
            "inner.weights must be three values, each a number between 0 and 1, got [0, nan, 1]",
            "inner.counts must be between 1 and 9, got 0",
            "inner.counts must be between 1 and 9, got 10",
        ]
    );
}

#[test]
fn missing_and_misfit_values_name_what_is_wanted() {
    assert_eq!(
        faults("share = \"much\"\ncount = -1\ninner = 3"),
        [
            "count must be a whole number between 1 and 10, got -1",
            "share must be a number above 0 and at most 0.5, got \"much\"",
            "colour is missing: one of red, blue",
            "inner must be a table, got 3",
        ]
    );
    assert_eq!(faults(&GOOD.replace("[1, 2]", "[1, 2, 3, 4]")), ["inner.counts must be at most 3 counts, got 4"]);
    assert!(matches!(read("count = = 1"), Err(Error::Syntax { .. })));
}

#[test]
fn hostile_values_are_refused_without_a_panic() {
    for value in
        ["nan", "-inf", "1e400", "-9223372036854775808", "9223372036854775807", "[]", "{}", "1979-05-27", "\"\""]
    {
        for key in ["count", "share", "colour", "is_on", "size_m", "weights", "counts", "inner"] {
            let line = GOOD.lines().find(|line| line.starts_with(key)).unwrap_or("[inner]");
            let bad = GOOD.replace(line, &format!("{key} = {value}"));
            assert!(read(&bad).is_err() || (key, value) == ("counts", "[]"), "{key} = {value}");
        }
    }
    let colourful = faults(&format!("\"\\u001b[31m\" = 1\nfile = [\"\\u001b[31m\"]\n{GOOD}"));
    assert_eq!(colourful[0], "\\u{1b}[31m is an unknown key");
    assert!(colourful.iter().all(|fault| !fault.contains('\u{1b}')), "{colourful:?}");
    let long = faults(&format!("share = \"{}\"\n{GOOD}", "é".repeat(1000)).replace("share = 0.5\n", ""));
    assert!(long[0].chars().count() < 200, "{long:?}");
}

#[test]
fn a_set_value_takes_the_place_of_the_texts() {
    let mut document = Document::parse(GOOD, Path::new("some.toml")).unwrap();
    document.set("colour", "red").unwrap();
    document.set("inner.counts", "[7]").unwrap();
    document.set("share", "1").unwrap();
    assert!(document.table().to_string().contains("share = 1.0"));
    for key in ["inner.count", "inner.counts.deep", "shares", ""] {
        let message = document.set(key, "1").unwrap_err().to_string();
        assert!(message.contains(&format!("there is no key {key}")), "{message}");
    }
    for (key, meant) in [("shares", "share"), ("colours", "colour"), ("weights", "inner.weights")] {
        let message = document.set(key, "1").unwrap_err().to_string();
        assert!(message.contains(&format!("there is no key {key}, did you mean {meant}?")), "{message}");
    }
    assert!(!document.set("sleep", "1").unwrap_err().to_string().contains("did you mean"));
    document.set("share", "0.25").unwrap();
    assert_eq!(document.read::<All>().unwrap().inner.counts, [7]);
}

#[test]
fn stored_settings_are_held_to_the_same_rows() {
    let mut all = read(GOOD).unwrap();
    let stored = |all: &All| toml::Table::try_from(all).unwrap();
    assert_eq!(read_stored::<All>(&stored(&all), "config").unwrap(), all);
    all.inner.size_m = [0.5, 1e6];
    let told = ["config.inner.size_m must be a range [low, high] within [0.1, 2], got [0.5, 1000000.0]"];
    assert_eq!(faults_of(&all, "config"), told);
    assert_eq!(read_stored::<All>(&stored(&all), "config").unwrap_err().len(), 1);
    // Another version's: fewer keys and others.
    let mut other = stored(&all);
    other.remove("colour");
    other.insert("sound".to_owned(), 1.into());
    assert_eq!(read_stored::<All>(&other, "config").unwrap_err().len(), 3);
}

#[test]
fn every_key_is_a_row_of_the_reference() {
    let rows = rows_of::<All>();
    let keys: Vec<&str> = rows.iter().map(|row| row.key.as_str()).collect();
    assert_eq!(keys, ["count", "share", "colour", "is_on", "file", "inner.size_m", "inner.weights", "inner.counts"]);
    assert_eq!(rows[0].meaning, "A whole number of two lines.");
    assert_eq!(rows[1].kind, "a number above 0 and at most 0.5");
    let defaults: Vec<Option<&str>> = rows.iter().map(|row| row.default.as_deref()).collect();
    assert_eq!(defaults, [None, None, None, Some("false"), Some("left out"), None, None, None]);
}

settings! {
    /// Tables that may be left out, and a list of tables.
    #[derive(Debug, Clone)]
    pub struct Outer {
        /// One or none.
        pub maybe: Option<Inner>; or None,
        /// Any number.
        pub many: Vec<Inner>,
        /// One of its own.
        pub usual: Inner; or Inner { size_m: [0.5, 1.0], weights: [1.0; 3], counts: vec![2, 3] },
    }
}

#[test]
fn tables_that_may_be_left_out_and_lists_of_tables_show_their_keys() {
    let rows = rows_of::<Outer>();
    let told = |row: &settings::Row| format!("{} = {}", row.key, row.default.as_deref().unwrap_or("?"));
    assert_eq!(
        rows.iter().map(told).collect::<Vec<_>>(),
        [
            "maybe = left out",
            "maybe.size_m = ?",
            "maybe.weights = ?",
            "maybe.counts = ?",
            "many = ?",
            "many[].size_m = ?",
            "many[].weights = ?",
            "many[].counts = ?",
            "usual.size_m = [0.5, 1]",
            "usual.weights = [1, 1, 1]",
            "usual.counts = [2, 3]",
        ]
    );
    assert_eq!((rows[0].kind.as_str(), rows[4].kind.as_str()), ("a table, or left out", "a list, each a table"));
}

#[test]
fn a_file_without_an_end_is_refused() {
    let error = Document::load(Some(Path::new("/dev/zero")), ["", ""]).unwrap_err();
    assert!(error.to_string().contains("settings must have at most 64 MiB"), "{error}");
}
