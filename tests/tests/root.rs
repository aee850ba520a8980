//! Laws that span crates: what the papers claim, determinism, files, and the workspace's own rules.
#![allow(clippy::unwrap_used, clippy::print_stderr, reason = "test code")]

mod claims;
mod determinism;
mod formats;
mod real_input;
mod report_page;
mod tidy;
