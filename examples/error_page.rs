//! Writes the book's page of errors: `cargo run --release --example error_page > docs/src/errors.md`.

#[path = "../tests/support/error_page.rs"]
mod error_page;

fn main() {
    print!("{}", error_page::page());
}
