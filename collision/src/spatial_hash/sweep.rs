//! Segments over a step as a search compares them, in `f32` and several at once: boxes, then two separating axes.
//!
//! Over a step a segment's middle moves linearly, and so does half of it, taken as a vector. Two segments stay apart for
//! the whole step if along some axis the distance of their middles exceeds what halves and relative motion can make up.
//! Hair is what the axes are chosen for: the way from one line to the other, which parts strands side by side, and the
//! common normal, which parts strands that cross over each other. Boxes cannot: neighbours' boxes always overlap, and a
//! head that moves sweeps them through each other. Invariant: round-off counts against parting, so that no pair that
//! comes within reach is ever lost.

use crate::segment_pair::Sweep;
use nalgebra::Vector3;

/// Candidates compared at once.
pub(super) const WIDTH: usize = 8;

/// Round-off of the comparison along an axis of unit sum, as a multiple of the largest coordinate: some sixty roundings
/// of 2⁻²⁴ each, twice over.
const ROUND_OFF: f32 = 128.0 / 16_777_216.0;

/// An axis-aligned box, cm, rounded outward to `f32`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct SweepBox {
    pub min: [f32; 3],
    pub max: [f32; 3],
}

impl SweepBox {
    /// The box that overlaps nothing.
    pub const EMPTY: Self = Self { min: [f32::INFINITY; 3], max: [f32::NEG_INFINITY; 3] };

    /// Box around a sweep, `inflate` cm wider on every side; [`Self::EMPTY`] if a coordinate is not finite.
    #[inline]
    pub fn around(sweep: &Sweep, inflate: f64) -> Self {
        let mut out = Self::EMPTY;
        let ([a, b], [c, d]) = (&sweep.start, &sweep.end);
        for k in 0..3 {
            let (low, high) = (a[k].min(b[k]).min(c[k]).min(d[k]), a[k].max(b[k]).max(c[k]).max(d[k]));
            // Of a number and none, the minimum is the number: the sum is what tells.
            if !(a[k] + b[k] + c[k] + d[k]).is_finite() {
                return Self::EMPTY;
            }
            (out.min[k], out.max[k]) = (round_down(low - inflate), round_up(high + inflate));
        }
        if out.min.iter().chain(&out.max).all(|c| c.is_finite()) { out } else { Self::EMPTY }
    }

    pub fn is_empty(&self) -> bool {
        !(0..3).all(|c| self.min[c] <= self.max[c])
    }

    /// Longest side, cm.
    pub fn size(&self) -> f64 {
        (0..3).map(|c| f64::from(self.max[c]) - f64::from(self.min[c])).fold(0.0, f64::max)
    }
}

#[inline(always)]
fn round_down(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) > x { y.next_down() } else { y }
}

#[inline(always)]
fn round_up(x: f64) -> f32 {
    let y = x as f32;
    if f64::from(y) < x { y.next_up() } else { y }
}

/// A sweep about the middle of the step: the segment's middle and half of it, and how both change over the step.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Motion {
    middle: [f32; 3],
    half: [f32; 3],
    middle_change: [f32; 3],
    half_change: [f32; 3],
}

impl Motion {
    #[inline]
    pub fn of(sweep: &Sweep) -> Self {
        let ([a, b], [c, d]) = (&sweep.start, &sweep.end);
        let f32s = |v: Vector3<f64>| [v.x as f32, v.y as f32, v.z as f32];
        Self {
            middle: f32s((a + b + c + d) * 0.25),
            half: f32s((b - a + d - c) * 0.25),
            middle_change: f32s((c + d - a - b) * 0.5),
            half_change: f32s((d - c - b + a) * 0.5),
        }
    }

    #[inline(always)]
    fn zip(&self, other: &Self, f: impl Fn(f32, f32) -> f32) -> Self {
        let each = |a: [f32; 3], b: [f32; 3]| [f(a[0], b[0]), f(a[1], b[1]), f(a[2], b[2])];
        Self {
            middle: each(self.middle, other.middle),
            half: each(self.half, other.half),
            middle_change: each(self.middle_change, other.middle_change),
            half_change: each(self.half_change, other.half_change),
        }
    }
}

/// As many numbers as are compared at once.
pub(super) type Lane = [f32; WIDTH];

/// Motions side by side.
#[derive(Clone, Copy, Debug)]
struct Motions {
    middle: [Lane; 3],
    half: [Lane; 3],
    middle_change: [Lane; 3],
    half_change: [Lane; 3],
}

impl Motions {
    const STILL: Self = Self {
        middle: [[0.0; WIDTH]; 3],
        half: [[0.0; WIDTH]; 3],
        middle_change: [[0.0; WIDTH]; 3],
        half_change: [[0.0; WIDTH]; 3],
    };

    #[inline(always)]
    fn set(&mut self, lane: usize, motion: &Motion) {
        for c in 0..3 {
            self.middle[c][lane] = motion.middle[c];
            self.half[c][lane] = motion.half[c];
            self.middle_change[c][lane] = motion.middle_change[c];
            self.half_change[c][lane] = motion.half_change[c];
        }
    }

    /// Which stay apart, however they stray by `spread`: not zero for those. `lengthwise` also looks along the segment
    /// asked about.
    #[inline(always)]
    fn parted(&self, query: &Query, spread: &Lane, lengthwise: bool) -> Flags {
        let own = &query.motion;
        let mut parted = [0; WIDTH];
        for l in 0..WIDTH {
            let at = |v: &[Lane; 3]| [v[0][l], v[1][l], v[2][l]];
            let between = Between {
                middles: sub(at(&self.middle), own.middle),
                change: sub(at(&self.middle_change), own.middle_change),
                halves: [own.half, at(&self.half)],
                half_changes: [own.half_change, at(&self.half_change)],
                reach: query.reach + spread[l],
                slack: query.slack,
            };
            parted[l] = i32::from(between.is_parted(query.across(between.middles)))
                | i32::from(between.is_parted(cross(own.half, between.halves[1])))
                | i32::from(lengthwise && between.is_parted(own.half));
        }
        parted
    }
}

/// One answer a lane, as whole integers, so that what makes them becomes vector instructions.
pub(super) type Flags = [i32; WIDTH];

/// Whether any is set.
#[inline(always)]
pub(super) fn any(flags: &Flags) -> bool {
    flags.iter().fold(0, |any, flag| any | flag) != 0
}

/// Neighbouring entries, compared at once.
#[derive(Clone, Copy, Debug)]
pub(super) struct EntryBlock {
    min: [Lane; 3],
    max: [Lane; 3],
    motions: Motions,
}

impl EntryBlock {
    /// Entries that meet nothing.
    pub const EMPTY: Self =
        Self { min: [[f32::INFINITY; WIDTH]; 3], max: [[f32::NEG_INFINITY; WIDTH]; 3], motions: Motions::STILL };

    /// Puts in an entry.
    #[inline(always)]
    pub fn set(&mut self, lane: usize, b: &SweepBox, motion: &Motion) {
        for c in 0..3 {
            (self.min[c][lane], self.max[c][lane]) = (b.min[c], b.max[c]);
        }
        self.motions.set(lane, motion);
    }

    /// Which entries may come within reach of the one asked for: not zero for those.
    #[inline(always)]
    pub fn may_meet(&self, query: &Query) -> Flags {
        let mut hit = [1; WIDTH];
        for c in 0..3 {
            for l in 0..WIDTH {
                hit[l] &= i32::from(self.min[c][l] <= query.bounds.max[c]);
                hit[l] &= i32::from(query.bounds.min[c] <= self.max[c][l]);
            }
        }
        // Boxes part most blocks already, at a tenth of the cost.
        if any(&hit) {
            let parted = self.motions.parted(query, &[0.0; WIDTH], false);
            for l in 0..WIDTH {
                hit[l] &= 1 - parted[l];
            }
        }
        hit
    }
}

/// Neighbouring cells, compared at once: the mean motion of what is filed there, and how far anything strays from it.
#[derive(Clone, Copy, Debug)]
pub(super) struct CellBlock {
    mean: Motions,
    spread: Lane,
}

impl CellBlock {
    /// Cells that nothing is filed in.
    pub const EMPTY: Self = Self { mean: Motions::STILL, spread: [f32::NEG_INFINITY; WIDTH] };

    /// Puts in the cell of some segments.
    #[inline]
    pub fn set<'a>(&mut self, lane: usize, motions: impl Iterator<Item = &'a Motion> + Clone) {
        let mut mean = Motion::default();
        let mut n = 0.0;
        for motion in motions.clone() {
            mean = mean.zip(motion, |a, b| a + b);
            n += 1.0;
        }
        let share = 1.0 / f32::max(n, 1.0);
        let mean = mean.zip(&mean, |a, _| a * share);
        self.mean.set(lane, &mean);
        // What no axis can see more of: each part's difference, as long as it is at the end of the step.
        self.spread[lane] = motions.fold(f32::NEG_INFINITY, |spread, motion| {
            let off = motion.zip(&mean, |a, b| a - b);
            let [a, b, c, d] = [off.middle, off.half, off.middle_change, off.half_change].map(|v| dot(v, v).sqrt());
            spread.max(a + b + 0.5 * (c + d))
        });
    }

    /// Which cells may hold a segment that comes within reach of the one asked for: not zero for those.
    #[inline(always)]
    pub fn may_hold(&self, query: &Query) -> Flags {
        self.mean.parted(query, &self.spread, true).map(|parted| 1 - parted)
    }
}

/// One sweep, asked about against many.
#[derive(Clone, Copy, Debug)]
pub(super) struct Query {
    pub bounds: SweepBox,
    motion: Motion,
    /// Reciprocal of the squared half length.
    per_half2: f32,
    reach: f32,
    /// Round-off along an axis of unit sum, cm.
    slack: f32,
}

impl Query {
    /// `other_size` is the longest side of the boxes it is compared with, cm.
    #[inline(always)]
    pub fn new(bounds: SweepBox, motion: Motion, reach: f32, other_size: f32) -> Self {
        let largest = bounds.min.iter().chain(&bounds.max).fold(0.0_f32, |m, c| m.max(c.abs()));
        Self {
            bounds,
            motion,
            // A point has no direction: then the way between the middles themselves is an axis.
            per_half2: 1.0 / dot(motion.half, motion.half).max(f32::MIN_POSITIVE),
            reach,
            slack: ROUND_OFF * (largest + other_size),
        }
    }

    /// The way to another segment's middle, square to this one.
    #[inline(always)]
    fn across(&self, middles: [f32; 3]) -> [f32; 3] {
        sub(middles, scale(self.motion.half, dot(middles, self.motion.half) * self.per_half2))
    }
}

/// What moves between two sweeps.
#[derive(Clone, Copy)]
struct Between {
    middles: [f32; 3],
    change: [f32; 3],
    halves: [[f32; 3]; 2],
    half_changes: [[f32; 3]; 2],
    reach: f32,
    slack: f32,
}

impl Between {
    /// Whether the segments stay further apart than the reach along an axis, of any length, all through the step. Not a
    /// number counts as no.
    #[inline(always)]
    fn is_parted(&self, axis: [f32; 3]) -> bool {
        let along = |v: [f32; 3]| dot(axis, v).abs();
        let made_up = along(self.halves[0])
            + along(self.halves[1])
            + 0.5 * (along(self.change) + along(self.half_changes[0]) + along(self.half_changes[1]));
        let sum = axis[0].abs() + axis[1].abs() + axis[2].abs();
        along(self.middles) - made_up > self.reach * dot(axis, axis).sqrt() + self.slack * sum
    }
}

#[inline(always)]
fn dot(a: [f32; 3], b: [f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[inline(always)]
fn sub(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

#[inline(always)]
fn scale(a: [f32; 3], s: f32) -> [f32; 3] {
    [a[0] * s, a[1] * s, a[2] * s]
}

#[inline(always)]
fn cross(a: [f32; 3], b: [f32; 3]) -> [f32; 3] {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
