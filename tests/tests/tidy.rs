//! The workspace keeps its own rules: what `cargo xtask tidy` checks, as a test.

#[path = "../../xtask/src/tidy.rs"]
mod rules;

use std::path::Path;

#[test]
fn the_workspace_is_tidy() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    let violations = rules::check(root).unwrap();
    let list: String = violations.iter().map(|v| format!("{v}\n")).collect();
    assert!(violations.is_empty(), "{list}");
}
