//! The header in the repository is the one that the entries ask for.
#![allow(clippy::unwrap_used, clippy::expect_used, reason = "test code")]

#[path = "../examples/header.rs"]
mod header;

#[test]
fn the_committed_header_is_what_is_generated() {
    let path = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join(header::HEADER);
    let committed = std::fs::read_to_string(path).unwrap();
    let generated = header::generate();
    let differs = committed.lines().zip(generated.lines()).position(|(a, b)| a != b);
    assert!(
        committed == generated,
        "{} is out of date from line {}; run `cargo run --release -p adaptive-runtime-c --example header`",
        header::HEADER,
        differs.map_or_else(|| committed.lines().count().min(generated.lines().count()), |k| k) + 1
    );
}
