//! Text, numbers and tables as HTML.

use serde_json::Value;

/// Text that is safe in HTML.
pub(super) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// The same, with what stands between grave accents as code.
pub(super) fn prose(text: &str) -> String {
    let mut html = String::new();
    for (i, part) in escape(text).split('`').enumerate() {
        html.push_str(&if i % 2 == 1 { format!("<code>{part}</code>") } else { part.to_owned() });
    }
    html
}

/// A table that scrolls sideways where it is wider than the screen. The first column is words; any other is what its first row is, words to the left,
/// numbers to the right.
pub(super) fn table(caption: &str, header: &[&str], rows: &[Vec<String>]) -> String {
    let mut html = format!(
        "<div class=\"scroll\" tabindex=\"0\" role=\"region\" aria-label=\"{0}\"><table><caption>{0}</caption><thead><tr>",
        escape(caption)
    );
    let words = |column: usize| {
        rows.first().and_then(|row| row.get(column)).is_some_and(|cell| cell.starts_with(char::is_alphabetic))
    };
    let class = |column: usize| if column > 0 && words(column) { " class=\"words\"" } else { "" };
    for (i, name) in header.iter().enumerate() {
        html.push_str(&format!("<th scope=\"col\"{}>{}</th>", class(i), escape(name)));
    }
    html.push_str("</tr></thead><tbody>");
    for row in rows {
        html.push_str("<tr>");
        for (i, cell) in row.iter().enumerate() {
            let tag = if i == 0 { "th scope=\"row\"" } else { "td" };
            html.push_str(&format!("<{tag}{}>{}</{}>", class(i), escape(cell), &tag[..2]));
        }
        html.push_str("</tr>");
    }
    html.push_str("</tbody></table></div>");
    html
}

pub(super) fn number(value: Option<&Value>, decimals: usize) -> String {
    value.and_then(Value::as_f64).map_or_else(|| "?".to_owned(), |v| format!("{v:.decimals$}"))
}

pub(super) fn list(value: Option<&Value>, decimals: usize) -> Vec<String> {
    let items = value.and_then(Value::as_array).cloned().unwrap_or_default();
    (0..3).map(|i| number(items.get(i), decimals)).collect()
}

pub(super) fn text(value: Option<&Value>) -> String {
    value.and_then(Value::as_str).unwrap_or("").to_owned()
}

pub(super) fn items(value: Option<&Value>) -> Vec<Value> {
    value.and_then(Value::as_array).cloned().unwrap_or_default()
}
