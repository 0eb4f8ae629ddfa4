//! The table as a page of the book.

use super::keys::{Kind, SECTIONS};

/// Every key with its kind, unit, default and meaning, as Markdown.
#[must_use]
pub fn markdown() -> String {
    let mut text = String::from(
        "# Every key\n\n<!-- Written by `cellmap schema --page`; change src/schema/keys.rs instead. -->\n\n\
         Lengths and angles are in the units that the file states. A key without a default must be there. `cellmap schema` prints the same as JSON Schema: \
         editors that know YAML then complete keys and mark mistakes while you type. With the YAML extension of VS Code, write\n\
         `# yaml-language-server: $schema=layout.schema.json` in the first line.\n",
    );
    for section in SECTIONS {
        text.push_str(&format!("\n## {}\n\n{}\n", section.name, section.words));
        if !section.one_of.is_empty() {
            let sets: Vec<String> = section
                .one_of
                .iter()
                .map(|set| set.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(" with "))
                .collect();
            let how = if section.or_none { "At most one of" } else { "Exactly one of" };
            text.push_str(&format!("{how}: {}.\n", sets.join(", ")));
        }
        text.push_str("\n| key | value | unit | default | meaning |\n|---|---|---|---|---|\n");
        for key in section.keys {
            let default = if key.default.is_empty() { "**required**" } else { key.default };
            text.push_str(&format!(
                "| `{}` | {} | {} | {default} | {} |\n",
                key.name,
                words(key.kind),
                key.unit,
                key.words
            ));
        }
    }
    text
}

fn words(kind: Kind) -> String {
    let choices = |words: &[&str]| words.iter().map(|word| format!("`{word}`")).collect::<Vec<_>>().join(", ");
    match kind {
        Kind::Whole(1, 1) => "`1`".to_owned(),
        Kind::Whole(least, most) => format!("whole number, {least} to {most}"),
        Kind::Number => "number".to_owned(),
        Kind::Positive => "number above 0".to_owned(),
        Kind::NotNegative => "number, at least 0".to_owned(),
        Kind::Share => "number, 0 to 1".to_owned(),
        Kind::Flag => "`true` or `false`".to_owned(),
        Kind::Text => "text".to_owned(),
        Kind::Choice(names) => choices(names),
        Kind::Numbers(count) => format!("list of {count} numbers"),
        Kind::List => "list of numbers".to_owned(),
        Kind::Counts(count) => format!("list of {count} whole numbers"),
        Kind::Ids => "list of ids".to_owned(),
        Kind::Rows(count) => format!("list of rows of {count} numbers"),
        Kind::Words([]) => "list of files".to_owned(),
        Kind::Words(names) => format!("list of {}", choices(names)),
        Kind::Section(name) => format!("[{name}](#{name})"),
        Kind::Named(inner) => format!("by name: {}", words(*inner)),
        Kind::ListOf(name) => format!("list of [{name}](#{name})"),
        Kind::Either(kinds) => kinds.iter().map(|kind| words(*kind)).collect::<Vec<_>>().join(" or "),
        Kind::Dictionary => "dictionary".to_owned(),
        Kind::Anything => "anything".to_owned(),
    }
}
