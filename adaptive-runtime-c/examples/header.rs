//! Writes include/adaptive_hair.h from the doc comments and signatures of the entries:
//! `cargo run --release -p adaptive-runtime-c --example header`.
//!
//! The header is kept in the repository, so that a host needs no generator; a test holds it to what is generated here.
#![allow(clippy::expect_used, reason = "a tool of developers stops at once")]

use std::path::Path;

/// Where the header is, relative to this package.
pub const HEADER: &str = "include/adaptive_hair.h";

/// The header as it should be.
///
/// # Panics
/// If the sources cannot be read.
pub fn generate() -> String {
    let package = Path::new(env!("CARGO_MANIFEST_DIR"));
    let config = cbindgen::Config::from_file(package.join("cbindgen.toml")).expect("a configuration");
    // Named one by one: given a whole crate, the generator would ask cargo about it.
    let mut builder = cbindgen::Builder::new().with_config(config);
    for source in ["types", "solids", "hair", "ffi"] {
        builder = builder.with_src(package.join("src").join(source).with_extension("rs"));
    }
    let mut bytes = Vec::new();
    builder.generate().expect("sources that can be read").write(&mut bytes);
    String::from_utf8(bytes).expect("text")
}

#[allow(dead_code, reason = "the test that includes this file has its own")]
fn main() {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(HEADER);
    std::fs::write(path, generate()).expect("a header that can be written");
}
