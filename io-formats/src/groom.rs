//! Grooms: strands as polylines, root first, in centimetres in the head frame at rest, and their resampling to a fixed
//! number of particles uniform by arc length.
//!
//! Readers check that coordinates are finite; whether the strands are usable hair is asked by [`Groom::validate`], so that
//! real grooms with a few degenerate strands can still be loaded and cleaned with [`Groom::drop_degenerate`].
//! Invariant of [`UniformGroom`]: `points.len() == n_strands * n_particles`, strand-major, root first.

use std::path::Path;
use std::str::FromStr;

use crate::error::{Error, Result};

/// Strands shorter than this (cm) have no usable direction and are called degenerate.
pub const MIN_STRAND_LENGTH_CM: f64 = 1e-4;

/// Most particles a strand may be resampled to; more is surely a mistake.
pub const MAX_PARTICLES: usize = 4096;

/// Arc length that counts as equal when deciding whether a polyline is uniform already, relative to its length.
const UNIFORM_TOLERANCE: f64 = 1e-6;

/// Strands of any point count.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Groom {
    /// Points of each strand, root first.
    pub point_counts: Vec<u32>,
    /// Positions (cm, head frame at rest), strand after strand.
    pub points: Vec<[f32; 3]>,
}

impl Groom {
    /// A groom from one list of points (cm) per strand.
    #[must_use]
    pub fn from_strands(strands: &[Vec<[f32; 3]>]) -> Self {
        Self { point_counts: strands.iter().map(|s| s.len() as u32).collect(), points: strands.concat() }
    }

    /// Number of strands.
    #[must_use]
    pub fn n_strands(&self) -> usize {
        self.point_counts.len()
    }

    /// `n_strands + 1` offsets into `points`: strand `i` is `offsets[i]..offsets[i + 1]`.
    #[must_use]
    pub fn offsets(&self) -> Vec<usize> {
        let mut at = 0;
        let mut offsets = Vec::with_capacity(self.point_counts.len() + 1);
        offsets.push(0);
        for &n in &self.point_counts {
            at += n as usize;
            offsets.push(at);
        }
        offsets
    }

    /// The points of strand `i`. Costs a walk over the counts before it: loops use [`Groom::strands`] or [`Groom::offsets`].
    ///
    /// # Panics
    /// If there is no such strand, or the counts exceed the points (see [`Groom::validate`]).
    #[must_use]
    pub fn strand(&self, i: usize) -> &[[f32; 3]] {
        let start: usize = self.point_counts[..i].iter().map(|&n| n as usize).sum();
        &self.points[start..start + self.point_counts[i] as usize]
    }

    /// All strands in order; a strand whose points are missing is cut short.
    pub fn strands(&self) -> impl Iterator<Item = &[[f32; 3]]> {
        let mut rest = self.points.as_slice();
        self.point_counts.iter().map(move |&n| {
            let (strand, after) = rest.split_at((n as usize).min(rest.len()));
            rest = after;
            strand
        })
    }

    /// The groom with every point `p` mapped to `scale * rotation * p + translation`. `rotation` is given by rows and may
    /// mirror (see [`negate_axes`]); `translation` is in cm.
    #[must_use]
    pub fn transformed(&self, scale: f32, rotation: [[f32; 3]; 3], translation: [f32; 3]) -> Self {
        Self {
            point_counts: self.point_counts.clone(),
            points: self.points.iter().map(|&p| transform_point(p, scale, &rotation, translation)).collect(),
        }
    }

    /// Checks that this is usable hair: counts add up, coordinates are finite, each strand has at least two points and is
    /// longer than [`MIN_STRAND_LENGTH_CM`].
    ///
    /// # Errors
    /// Names the first offending strand and how many there are.
    pub fn validate(&self) -> Result<()> {
        self.check_counts()?;
        if self.point_counts.is_empty() {
            return Err(Error::EmptyGroom);
        }
        check_finite(self.strands())?;
        let mut short = (0, None);
        let mut degenerate = (0, None);
        for (i, strand) in self.strands().enumerate() {
            if strand.len() < 2 {
                short.0 += 1;
                short.1.get_or_insert(i);
            } else {
                let length = arc_length(strand);
                if length <= MIN_STRAND_LENGTH_CM {
                    degenerate.0 += 1;
                    degenerate.1.get_or_insert((i, length));
                }
            }
        }
        if let (n_bad, Some(strand)) = short {
            return Err(Error::TooFewPoints { strand, n_points: self.point_counts[strand], n_bad });
        }
        if let (n_bad, Some((strand, length_cm))) = degenerate {
            return Err(Error::DegenerateStrand { strand, length_cm, n_bad });
        }
        Ok(())
    }

    /// Removes strands with fewer than two points, non-finite points or no length; returns how many were removed.
    pub fn drop_degenerate(&mut self) -> usize {
        let mut kept = Self::default();
        for strand in self.strands() {
            let finite = strand.iter().flatten().all(|x| x.is_finite());
            if strand.len() >= 2 && finite && arc_length(strand) > MIN_STRAND_LENGTH_CM {
                kept.point_counts.push(strand.len() as u32);
                kept.points.extend_from_slice(strand);
            }
        }
        let n_dropped = self.n_strands() - kept.n_strands();
        *self = kept;
        n_dropped
    }

    /// Every strand as `n_particles` points at equal arc length along the polyline; the first and last points are kept
    /// exactly. A strand that is uniform already with that count is copied unchanged.
    ///
    /// # Errors
    /// As [`Groom::validate`]; [`Error::BadParticleCount`] outside 2 to [`MAX_PARTICLES`].
    pub fn resample(&self, n_particles: usize) -> Result<UniformGroom> {
        if !(2..=MAX_PARTICLES).contains(&n_particles) {
            return Err(Error::BadParticleCount { n_particles, max: MAX_PARTICLES });
        }
        self.validate()?;
        let mut points = Vec::with_capacity(self.n_strands() * n_particles);
        let mut at = Vec::new();
        for strand in self.strands() {
            resample_strand(strand, n_particles, &mut at, &mut points);
        }
        Ok(UniformGroom { n_strands: self.n_strands(), n_particles, points })
    }

    fn check_counts(&self) -> Result<()> {
        let n_counted: u64 = self.point_counts.iter().map(|&n| u64::from(n)).sum();
        if n_counted == self.points.len() as u64 {
            Ok(())
        } else {
            Err(Error::PointCountMismatch { n_points: self.points.len(), n_counted })
        }
    }
}

/// Strands of one fixed particle count, uniform by arc length along the polylines they were made from.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct UniformGroom {
    /// Number of strands.
    pub n_strands: usize,
    /// Particles of each strand, root included.
    pub n_particles: usize,
    /// `n_strands * n_particles` positions (cm, head frame at rest), strand-major, root first.
    pub points: Vec<[f32; 3]>,
}

impl UniformGroom {
    /// The particles of strand `i`, root first.
    ///
    /// # Panics
    /// If there is no such strand.
    #[must_use]
    pub fn strand(&self, i: usize) -> &[[f32; 3]] {
        &self.points[i * self.n_particles..(i + 1) * self.n_particles]
    }

    /// The same strands as a [`Groom`].
    #[must_use]
    pub fn to_groom(&self) -> Groom {
        Groom { point_counts: vec![self.n_particles as u32; self.n_strands], points: self.points.clone() }
    }
}

/// How long one unit of a file is. Never guessed: a file's unit is always stated by whoever opens it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum LengthUnit {
    /// Metre.
    M,
    /// Centimetre, the unit used inside.
    Cm,
    /// Millimetre.
    Mm,
    /// Inch, 2.54 cm.
    Inch,
    /// Any other, as centimetres per unit; positive and finite.
    Other(f64),
}

impl LengthUnit {
    /// Centimetres per unit.
    #[must_use]
    pub fn cm_per_unit(self) -> f64 {
        match self {
            Self::M => 100.0,
            Self::Cm => 1.0,
            Self::Mm => 0.1,
            Self::Inch => 2.54,
            Self::Other(cm) => cm,
        }
    }
}

impl FromStr for LengthUnit {
    type Err = Error;

    /// `m`, `cm`, `mm`, `in`, or a positive number of centimetres per unit.
    fn from_str(s: &str) -> Result<Self> {
        match s.trim() {
            "m" => Ok(Self::M),
            "cm" => Ok(Self::Cm),
            "mm" => Ok(Self::Mm),
            "in" => Ok(Self::Inch),
            other => match other.parse::<f64>() {
                Ok(cm) if cm.is_finite() && cm > 0.0 => Ok(Self::Other(cm)),
                _ => Err(Error::UnknownUnit { given: s.to_owned() }),
            },
        }
    }
}

/// Reads a groom by its extension: `.hair`, `.tfx`, USC's `.data`, or the strands of a `.ply`. Strands may still be degenerate, see [`Groom::validate`].
///
/// # Errors
/// Those of the format's reader; [`Error::UnknownExtension`] for any other extension.
pub fn read_groom(path: &Path, unit: LengthUnit) -> Result<Groom> {
    let extension = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
    match extension.as_deref() {
        Some("hair") => crate::hair::read_hair(path, unit),
        Some("tfx") => crate::tfx::read_tfx(path, unit),
        Some("data") => crate::usc::read_data(path, unit),
        Some("ply") => crate::ply::read_ply_strands(path, unit),
        _ => Err(Error::UnknownExtension { path: path.to_path_buf(), expected: ".hair, .tfx, .data, .ply" }),
    }
}

/// The matrix, by rows, that negates the axes marked `true`.
#[must_use]
pub fn negate_axes(negate: [bool; 3]) -> [[f32; 3]; 3] {
    let sign = negate.map(|n| if n { -1.0 } else { 1.0 });
    [[sign[0], 0.0, 0.0], [0.0, sign[1], 0.0], [0.0, 0.0, sign[2]]]
}

/// `scale * rotation * p + translation`.
pub(crate) fn transform_point(p: [f32; 3], scale: f32, rotation: &[[f32; 3]; 3], translation: [f32; 3]) -> [f32; 3] {
    std::array::from_fn(|k| {
        let row = rotation[k];
        scale * (row[0] * p[0] + row[1] * p[1] + row[2] * p[2]) + translation[k]
    })
}

/// Length of a polyline, summed in double precision.
#[must_use]
pub fn arc_length(points: &[[f32; 3]]) -> f64 {
    points.windows(2).map(|w| distance(w[0], w[1])).sum()
}

fn distance(a: [f32; 3], b: [f32; 3]) -> f64 {
    let mut sum = 0.0;
    for k in 0..3 {
        let d = f64::from(b[k]) - f64::from(a[k]);
        sum += d * d;
    }
    sum.sqrt()
}

fn check_finite<'a>(strands: impl Iterator<Item = &'a [[f32; 3]]>) -> Result<()> {
    let mut n_bad = 0;
    let mut first = None;
    for (i, strand) in strands.enumerate() {
        if let Some(point) = strand.iter().position(|p| p.iter().any(|x| !x.is_finite())) {
            n_bad += 1;
            first.get_or_insert((i, point));
        }
    }
    match first {
        Some((strand, point)) => Err(Error::NonFiniteStrand { strand, point, n_bad }),
        None => Ok(()),
    }
}

/// Appends `n` points to `out`; `at` is scratch for the arc length at each source point.
fn resample_strand(strand: &[[f32; 3]], n: usize, at: &mut Vec<f64>, out: &mut Vec<[f32; 3]>) {
    at.clear();
    at.push(0.0);
    let mut total = 0.0;
    for w in strand.windows(2) {
        total += distance(w[0], w[1]);
        at.push(total);
    }
    let step = total / (n - 1) as f64;
    // Without this, resampling twice would move points by round-off, and a file of uniform strands would not survive.
    let uniform = strand.len() == n
        && at.iter().enumerate().all(|(i, &s)| (s - step * i as f64).abs() <= UNIFORM_TOLERANCE * total);
    if uniform {
        out.extend_from_slice(strand);
        return;
    }
    out.push(strand[0]);
    let mut seg = 0;
    for i in 1..n - 1 {
        let s = step * i as f64;
        while seg + 2 < at.len() && at[seg + 1] < s {
            seg += 1;
        }
        let span = at[seg + 1] - at[seg];
        let t = if span > 0.0 { ((s - at[seg]) / span).clamp(0.0, 1.0) } else { 0.0 };
        let (a, b) = (strand[seg], strand[seg + 1]);
        out.push(std::array::from_fn(|k| (f64::from(a[k]) + t * (f64::from(b[k]) - f64::from(a[k]))) as f32));
    }
    out.push(strand[strand.len() - 1]);
}
