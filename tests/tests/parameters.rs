//! Parameters of functions. A tuple among them hides how many there are: values that belong together are a struct, and
//! others stand alone.

use workspace_tests::{assert_none, files};

/// What stands between the commas of the bracket with which a text begins, and the text after it.
fn bracket(text: &str) -> (Vec<&str>, &str) {
    let (mut parts, mut depth, mut start, mut before) = (Vec::new(), 0, 1, ' ');
    for (at, letter) in text.char_indices() {
        match letter {
            '(' | '[' | '{' | '<' => depth += 1,
            ')' | ']' | '}' => depth -= 1,
            '>' if !"-=".contains(before) => depth -= 1,
            _ => {}
        }
        if depth == 0 || (depth == 1 && letter == ',') {
            parts.push(text[start..at].trim());
            start = at + 1;
        }
        if depth == 0 {
            parts.retain(|part| !part.is_empty());
            return (parts, &text[start..]);
        }
        before = letter;
    }
    (parts, "")
}

/// Whether a parameter's type is a tuple, or a reference to one.
fn is_tuple(parameter: &str) -> bool {
    let is_whole = |pattern: &str| {
        ["()", "[]", "{}"].iter().all(|pair| {
            let count = |at: usize| pattern.matches(&pair[at..=at]).count();
            count(0) == count(1)
        })
    };
    let mut colons = parameter.match_indices(": ").map(|(at, _)| at);
    let Some(colon) = colons.find(|at| is_whole(&parameter[..*at])) else { return false };
    let mut kind = parameter[colon + 2..].trim_start();
    while let Some(referred) = kind.strip_prefix('&') {
        let referred =
            if referred.starts_with('\'') { referred.split_once(' ').map_or("", |(_, rest)| rest) } else { referred };
        kind = referred.strip_prefix("mut ").unwrap_or(referred);
    }
    kind.starts_with('(') && bracket(kind).0.len() > 1
}

/// The functions of a text outside of its unit tests that take a tuple.
fn with_tuples(text: &str) -> Vec<String> {
    let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or(text);
    let code: Vec<&str> = code.lines().map(|line| line.split("//").next().unwrap_or(line)).collect();
    let code = code.join("\n");
    let mut found = Vec::new();
    for (at, word) in code.match_indices("fn ").filter(|(at, _)| *at == 0 || code[..*at].ends_with([' ', '\n'])) {
        let rest = &code[at + word.len()..];
        let name = &rest[..rest.find(|letter: char| letter != '_' && !letter.is_alphanumeric()).unwrap_or(0)];
        let rest = &rest[name.len()..];
        let list = if rest.starts_with('<') { bracket(rest).1 } else { rest };
        if list.starts_with('(') && bracket(list).0.into_iter().any(is_tuple) {
            found.push(name.to_owned());
        }
    }
    found
}

#[test]
fn tuples_are_found() {
    let text = "fn a(x: u8, (y, z): (u8, &[u8; 2])) {}\nfn b<T: Fn(&u8) -> u8>(&self, at: &'a mut (u8, T)) {}\n\
                fn c(x: (), f: &(dyn Fn(u8, u8) -> (u8, u8) + Sync), v: Vec<(u8, u8)>, P { x: (y, _), .. }: P) {}\n\
                #[cfg(test)]\nmod tests {\n    fn d((x, y): (u8, u8)) {}\n}\n";
    assert_eq!(with_tuples(text), ["a", "b"]);
}

#[test]
fn functions_take_no_tuples() {
    let is_product = |path: &str| path.ends_with(".rs") && path.contains("/src/") && !path.starts_with("fuzz/");
    let mut found = Vec::new();
    for file in files(is_product) {
        found.extend(with_tuples(&file.text).iter().map(|name| format!("{}: {name} takes a tuple", file.path)));
    }
    assert_none("parameters", &found);
}
