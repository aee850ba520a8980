//! The one error type of this crate: each variant is a cause, its fields say what, where and why.
//!
//! Messages are lower case without a full stop, and end with what to do where that is not evident.

use std::path::{Path, PathBuf};

/// Shorthand used throughout the crate.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// Why a file, groom, motion or scene was refused.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused a file operation.
    #[error("cannot {action} {path}: {source}", path = path.display())]
    Io {
        /// What was attempted: `read`, `create`, `write`, `rename`.
        action: &'static str,
        /// The file it was attempted on.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// A field or array reaches past the end of the file.
    #[error(
        "{path}: {field} at byte {offset} needs {needed} bytes, but only {available} are left; the file is cut short or its counts are wrong",
        path = path.display()
    )]
    Truncated {
        /// The file.
        path: PathBuf,
        /// The field or array being read.
        field: &'static str,
        /// Byte offset of the field.
        offset: u64,
        /// Bytes the field takes.
        needed: u64,
        /// Bytes left from the offset on.
        available: u64,
    },
    /// The first bytes are not those of the expected format.
    #[error("{path}: not a {format} file (it starts with {found})", path = path.display())]
    BadMagic {
        /// The file.
        path: PathBuf,
        /// The format that was asked for.
        format: &'static str,
        /// The first bytes, printable.
        found: String,
    },
    /// The format is right, the version is not one this crate reads.
    #[error("{path}: {format} version {found} is not supported; {hint}", path = path.display())]
    UnsupportedVersion {
        /// The file.
        path: PathBuf,
        /// The format.
        format: &'static str,
        /// The version found.
        found: String,
        /// What is supported or what to do.
        hint: String,
    },
    /// A field of a binary file holds a value that cannot be right.
    #[error("{path}: {field} at byte {offset}: {reason}", path = path.display())]
    BadField {
        /// The file.
        path: PathBuf,
        /// The field.
        field: &'static str,
        /// Byte offset of the field.
        offset: u64,
        /// What is wrong with it.
        reason: String,
    },
    /// A line of a text file cannot be understood.
    #[error("{path}, line {line}: {reason}", path = path.display())]
    BadLine {
        /// The file.
        path: PathBuf,
        /// Line number, from 1; the last line where the file ends too early.
        line: usize,
        /// What was expected and what was found.
        reason: String,
    },
    /// The extension names no format this crate reads.
    #[error("{path}: unknown extension; expected one of {expected}", path = path.display())]
    UnknownExtension {
        /// The file.
        path: PathBuf,
        /// The extensions that would do.
        expected: &'static str,
    },
    /// A unit is neither a known name nor a positive number.
    #[error("unknown length unit {given:?}; use \"m\", \"cm\", \"mm\", \"in\" or the number of centimetres per unit")]
    UnknownUnit {
        /// The text given.
        given: String,
    },
    /// The point counts of a groom do not add up to its points.
    #[error("groom has {n_points} points, but its strands count {n_counted}")]
    PointCountMismatch {
        /// Points present.
        n_points: usize,
        /// Sum of the strands' point counts.
        n_counted: u64,
    },
    /// A groom without strands.
    #[error("groom has no strands")]
    EmptyGroom,
    /// A coordinate of a groom is not a finite number.
    #[error("strand {strand}, point {point} is not finite; {n_bad} strands have such points")]
    NonFiniteStrand {
        /// First offending strand.
        strand: usize,
        /// Its first offending point.
        point: usize,
        /// Number of offending strands.
        n_bad: usize,
    },
    /// Strands with fewer than two points.
    #[error(
        "strand {strand} has {n_points} point(s), at least 2 are needed; {n_bad} strands are too short (drop_degenerate removes them)"
    )]
    TooFewPoints {
        /// First offending strand.
        strand: usize,
        /// Its number of points.
        n_points: u32,
        /// Number of offending strands.
        n_bad: usize,
    },
    /// Strands of no length.
    #[error(
        "strand {strand} is only {length_cm:e} cm long; {n_bad} strands are degenerate: check the unit, or drop them (drop_degenerate)"
    )]
    DegenerateStrand {
        /// First offending strand.
        strand: usize,
        /// Its arc length in centimetres.
        length_cm: f64,
        /// Number of offending strands.
        n_bad: usize,
    },
    /// A strand cannot be resampled to so few or so many particles.
    #[error("cannot resample to {n_particles} particles a strand; use 2 to {max}")]
    BadParticleCount {
        /// The count asked for.
        n_particles: usize,
        /// The largest count accepted.
        max: usize,
    },
    /// A mesh that cannot serve as a solid.
    #[error("{path}: bad mesh: {reason}", path = path.display())]
    BadMesh {
        /// The file.
        path: PathBuf,
        /// What is wrong with it.
        reason: String,
    },
    /// A joint name that the motion does not have.
    #[error("{path}: no joint named {name:?}; the joints are {known}", path = path.display())]
    UnknownJoint {
        /// The motion file.
        path: PathBuf,
        /// The name asked for.
        name: String,
        /// All joint names, in file order.
        known: String,
    },
    /// A motion that cannot be used as asked.
    #[error("bad motion: {reason}")]
    BadMotion {
        /// What is wrong with it.
        reason: String,
    },
    /// A scene file that is not valid TOML, or has an unknown or missing field.
    #[error("{path}: {source}", path = path.display())]
    SceneSyntax {
        /// The scene file.
        path: PathBuf,
        /// The parser's error, with line and column.
        source: Box<toml::de::Error>,
    },
    /// A scene field whose value makes no sense.
    #[error("{path}: {field}: {reason}", path = path.display())]
    SceneField {
        /// The scene file.
        path: PathBuf,
        /// The field, as `table.field`.
        field: String,
        /// What is wrong with it.
        reason: String,
    },
    /// One of our own files, but of another kind.
    #[error("{path}: holds a {found}, but a {expected} was expected; check the path", path = path.display())]
    WrongKind {
        /// The file.
        path: PathBuf,
        /// The kind expected.
        expected: String,
        /// The kind found.
        found: String,
    },
    /// The length in the header is not that of the file.
    #[error(
        "{path}: the header promises {promised} bytes of payload, the file has {actual}; it was cut short or appended to: copy or make it again",
        path = path.display()
    )]
    WrongLength {
        /// The file.
        path: PathBuf,
        /// Payload bytes by the header.
        promised: u64,
        /// Payload bytes in the file.
        actual: u64,
    },
    /// The payload is not what was written.
    #[error("{path}: checksum of {part} does not match; the file is damaged: copy or make it again", path = path.display())]
    Checksum {
        /// The file.
        path: PathBuf,
        /// The damaged part: `payload`, `header`, or a frame.
        part: String,
    },
    /// A payload that passes its checksum but cannot be decoded.
    #[error("{path}: cannot decode the {what}: {reason}", path = path.display())]
    Decode {
        /// The file.
        path: PathBuf,
        /// What it should be.
        what: &'static str,
        /// The decoder's reason.
        reason: String,
    },
    /// A skinning model that breaks one of its invariants.
    #[error("bad skinning model: {field}: {reason}; train it again")]
    BadModel {
        /// The field.
        field: &'static str,
        /// The broken invariant.
        reason: String,
    },
    /// A frame number past the end, or a buffer of the wrong size.
    #[error("bad frame request: {reason}")]
    BadFrame {
        /// What is wrong with it.
        reason: String,
    },
    /// Data that cannot be expressed in the format being written.
    #[error("cannot write {path}: {reason}", path = path.display())]
    CannotWrite {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        reason: String,
    },
}

impl Error {
    /// An [`Error::Io`] for `action` on `path`, in the form `map_err` takes.
    pub(crate) fn io(action: &'static str, path: &Path) -> impl FnOnce(std::io::Error) -> Self {
        let path = path.to_path_buf();
        move |source| Self::Io { action, path, source }
    }
}
