//! Numbers and errors as text.

use std::error::Error;

/// `1234567` as `1,234,567`.
#[must_use]
pub fn grouped(number: u64) -> String {
    match number / 1000 {
        0 => number.to_string(),
        thousands => format!("{},{:03}", grouped(thousands), number % 1000),
    }
}

/// `0.1234` as `12.3 %`.
#[must_use]
pub fn percent(share: f64) -> String {
    format!("{:.1} %", 100.0 * share)
}

/// Positives to negatives, such as `1 : 2.90`.
#[must_use]
pub fn ratio(positives: u64, negatives: u64) -> String {
    match positives {
        0 => format!("0 : {}", grouped(negatives)),
        positives => format!("1 : {:.2}", negatives as f64 / positives as f64),
    }
}

/// `12345678` as `11.8 MiB`.
#[must_use]
pub fn bytes(bytes: u64) -> String {
    let mut value = bytes as f64;
    for unit in ["B", "KiB", "MiB", "GiB"] {
        if value < 1024.0 {
            let digits = usize::from(unit != "B");
            return format!("{value:.digits$} {unit}");
        }
        value /= 1024.0;
    }
    format!("{value:.1} TiB")
}

/// An error's message, followed by those of its causes that it does not contain already.
#[must_use]
pub fn error_chain(error: &(dyn Error + 'static)) -> String {
    let mut text = error.to_string();
    let mut cause = error.source();
    while let Some(inner) = cause {
        let more = inner.to_string();
        if !text.contains(&more) {
            text = format!("{text}: {more}");
        }
        cause = inner.source();
    }
    text
}

/// Splits an argument such as `views.count=3`.
///
/// # Errors
/// Without an equals sign.
pub fn key_and_value(text: &str) -> Result<(String, String), String> {
    let parts = text.split_once('=').ok_or_else(|| format!("must be KEY=VALUE, got {text}"))?;
    Ok((parts.0.trim().to_owned(), parts.1.trim().to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_read_well() {
        assert_eq!([0, 999, 1_000, 1_234_567].map(grouped), ["0", "999", "1,000", "1,234,567"]);
        assert_eq!([12, 2_048, 12_345_678].map(bytes), ["12 B", "2.0 KiB", "11.8 MiB"]);
        assert_eq!(ratio(10, 30), "1 : 3.00");
        assert_eq!(ratio(0, 40), "0 : 40");
    }
}
