//! Numbers as text.

/// The shortest text that is read back as the same number, with what is nothing but rounding written as 0.
#[must_use]
pub(super) fn number(value: f64) -> String {
    if value.abs() < 1e-15 { "0".to_owned() } else { value.to_string() }
}

/// Numbers with something between them.
#[must_use]
pub(super) fn numbers(values: &[f64], between: &str) -> String {
    values.iter().map(|value| number(*value)).collect::<Vec<_>>().join(between)
}
