//! The header in the repository is the one that the entries ask for.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "test code")]

#[path = "../examples/header.rs"]
mod header;

#[test]
fn the_committed_header_is_what_is_generated() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(header::HEADER);
    let committed = std::fs::read_to_string(path).unwrap();
    let generated = header::generate();
    let (lines, all) = (committed.lines(), committed.lines().count().min(generated.lines().count()));
    let line = lines.zip(generated.lines()).position(|(a, b)| a != b).unwrap_or(all) + 1;
    assert!(
        committed == generated,
        "{} is out of date from line {line}; run `cargo run --release -p adaptive-runtime-c --example header`",
        header::HEADER
    );
}
